//! The bytes of the .esker file: writer, reader, verify; the only crate that knows them.
