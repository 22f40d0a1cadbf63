//! Trees over discs and triangles, and their traversal.
