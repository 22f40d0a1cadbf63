//! Filters of indirect light, guided by normals and depth.
