// The depth at which another surface begins, for silhouette. Needs variables `frame` and `tint`.
// Twin: `Rims::limit` in crates/render/src/passes/silhouette/rim.rs.

// Depth beyond which a surface is another one than that of a pixel at `depth` with source `source`.
fn limit(depth: f32, source: u32) -> f32 {
    return depth * (1.0 + tint[source].w * (1.0 / frame.focal_px));
}
