//! Paths: guide rays, indirect and direct light, lookup, accumulation.
