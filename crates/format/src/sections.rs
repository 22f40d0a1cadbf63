//! Sections of a file that are read and checked on opening: footer, metadata, table.

use crate::columns::{ColumnPlaces, Read};
use crate::error::{Fault, FormatError, io_error};
use crate::footer::{FOOTER_BYTES, Footer, FooterFault, HEADER_BYTES, HEADER_MAGIC, Section};
use crate::metadata::{METADATA_BYTES_MAX, Metadata};
use esker_points::read_at::ReadAt;
use esker_points::{Node, NodeTable};
use std::path::Path;

pub(crate) fn read_footer(path: &Path, source: &dyn ReadAt) -> Result<Footer, FormatError> {
    let not_esker =
        |fault: &str| FormatError::NotEsker { path: path.into(), fault: fault.to_string() };
    let file_bytes = source.bytes().map_err(io_error(path, "read its length"))?;
    if file_bytes < (HEADER_BYTES + FOOTER_BYTES) as u64 {
        return Err(not_esker("it is too short"));
    }
    let mut head = [0; HEADER_MAGIC.len()];
    source.read_exact_at(&mut head, 0).map_err(io_error(path, "read its header"))?;
    if head != HEADER_MAGIC {
        return Err(FormatError::Unsupported {
            path: path.into(),
            what: "is not an .esker file; if it is a scan, build one first: esker build SCAN -o FILE.esker".into(),
        });
    }
    let mut bytes = [0; FOOTER_BYTES];
    let offset = file_bytes - FOOTER_BYTES as u64;
    source.read_exact_at(&mut bytes, offset).map_err(io_error(path, "read its footer"))?;
    let footer = Footer::decode(&bytes).map_err(|fault| match fault {
        FooterFault::None(fault) => not_esker(fault),
        FooterFault::Version(version) => FormatError::Unsupported {
            path: path.into(),
            what: match version {
                0 => "version 0 of the format, from before it was frozen; build it again".into(),
                later => format!("version {later} of the format; use a newer Esker to read it"),
            },
        },
    })?;
    if footer.file_bytes != file_bytes {
        return Err(not_esker("its length is not what the footer says"));
    }
    Ok(footer)
}

/// Checks that sections follow each other without gaps, from the end of the pages to the footer.
pub(crate) fn check_sections(footer: &Footer) -> Result<(), Fault> {
    let fault = |what: &str| Err(Fault::new("footer", what));
    let mut end = Some(footer.table.offset);
    for section in [footer.table, footer.statistics, footer.metadata, footer.verbatim] {
        if end != Some(section.offset) {
            return fault("the sections do not follow each other");
        }
        end = section.end();
    }
    if end != footer.file_bytes.checked_sub(FOOTER_BYTES as u64)
        || footer.table.offset < HEADER_BYTES as u64
    {
        return fault("the sections do not fill the file");
    }
    if footer.nodes >= u64::from(u32::MAX)
        || footer.nodes * size_of::<Node>() as u64 != footer.table.bytes
    {
        return fault("the table's length does not suit its count of nodes");
    }
    if footer.metadata.bytes > METADATA_BYTES_MAX {
        return fault("the metadata are longer than any that Esker writes");
    }
    Ok(())
}

/// Checks the numbers that are both in the footer and elsewhere.
pub(crate) fn check_counts(footer: &Footer, metadata: &Metadata) -> Result<(), Fault> {
    if footer.node_capacity != metadata.node_capacity
        || footer.rounding_error_max.to_bits() != metadata.rounding_error_max().to_bits()
    {
        return Err(Fault::new("metadata", "capacity or rounding error are not the footer's"));
    }
    metadata.check_classes(footer.points)
}

/// Reads a section. It is within the file (checked before), so the allocation is bounded by the
/// file's size.
pub(crate) fn read_section(
    path: &Path,
    source: &dyn ReadAt,
    section: Section,
    name: &'static str,
) -> Result<Vec<u8>, FormatError> {
    let mut bytes = vec![0; section.bytes as usize];
    source.read_exact_at(&mut bytes, section.offset).map_err(io_error(path, "read it"))?;
    if crc32fast::hash(&bytes) != section.crc {
        return Err(Fault::new(name, "its checksum does not match").damaged(path));
    }
    Ok(bytes)
}

/// Reads the whole node table, and the sides of its contours.
pub(crate) fn read_table(
    path: &Path,
    source: &dyn ReadAt,
    footer: &Footer,
    places: &ColumnPlaces,
) -> Result<NodeTable, FormatError> {
    let mut nodes = vec![bytemuck::Zeroable::zeroed(); footer.nodes as usize];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut::<Node, u8>(&mut nodes);
    source.read_exact_at(bytes, footer.table.offset).map_err(io_error(path, "read its table"))?;
    if crc32fast::hash(bytes) != footer.table.crc {
        return Err(Fault::new("node table", "its checksum does not match").damaged(path));
    }
    let sides = of_columns(path, places.sides(source))?;
    Ok(NodeTable { sides, ..NodeTable::of_tree(nodes) })
}

/// What was read of the statistics, or the error of reading them.
pub(crate) fn of_columns<T>(path: &Path, read: Read<T>) -> Result<T, FormatError> {
    read.map_err(io_error(path, "read its statistics"))?.map_err(|fault| fault.damaged(path))
}
