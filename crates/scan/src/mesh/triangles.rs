//! The triangle mesh that all parts of the program share: vertices with normals and colours, and
//! triangles as indices of vertices.

/// Greatest number of vertices of a mesh: with their normals and a tree over the triangles, more
/// would take above 8 GiB.
pub const VERTICES_MAX: usize = 1 << 26;
/// Greatest number of triangles of a mesh.
pub const TRIANGLES_MAX: usize = 1 << 26;

/// A triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Positions of the vertices, in the unit of the file.
    pub positions: Vec<[f64; 3]>,
    /// Normal of each vertex, unit length.
    pub normals: Vec<[f32; 3]>,
    /// Colour of each vertex, sRGB; empty if the mesh has none.
    pub colours: Vec<[u8; 3]>,
    /// Corners of each triangle: indices of vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// What was left out of a file and why, a line each.
    pub notes: Vec<String>,
}

impl TriangleMesh {
    /// Least and greatest coordinates of the vertices; `None` if there is no vertex.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold([first; 2], |[lo, hi], p| {
            [[0, 1, 2].map(|i| lo[i].min(p[i])), [0, 1, 2].map(|i| hi[i].max(p[i]))]
        }))
    }

    /// Positions of the corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
}

/// A mesh as a file holds it. `normals` and `colours` are empty or have one entry a vertex.
#[derive(Debug, Default)]
pub(crate) struct RawMesh {
    pub positions: Vec<[f64; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub colours: Vec<[u8; 3]>,
    pub triangles: Vec<[u32; 3]>,
    pub notes: Vec<String>,
}

/// Twice the area of a triangle times its normal.
pub(crate) fn cross([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (u, v) = (sub(b, a), sub(c, a));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] + b[i])
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The unit vector of this direction; `None` if the length is zero or not finite.
pub(crate) fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    // Scaled first, so that squares of tiny or huge values neither vanish nor overflow.
    let most = a.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    if !(most > 0.0 && most.is_finite() && a.iter().all(|c| c.is_finite())) {
        return None;
    }
    let a = a.map(|c| c / most);
    let length = dot(a, a).sqrt();
    Some(a.map(|c| c / length))
}
