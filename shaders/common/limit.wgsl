// Where another surface begins. Needs variables `frame`, `tint`. Twin: `Rims::limit` in crates/render/src/passes/silhouette/rim.rs.

// Depth beyond which there is another surface than that of a pixel at `depth` which shows `shown`.
fn limit(depth: f32, shown: u32) -> f32 {
    return depth * (1.0 + tint[shown].w * (1.0 / frame.focal_px));
}
