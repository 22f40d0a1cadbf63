//! Closed solids as parts of a mesh: boxes, extruded bands and solids of revolution. The vertices
//! of a solid are shared by its triangles; edges become sharp when normals are computed.

use crate::mesh::normals::computed;
use crate::mesh::triangles::TriangleMesh;

/// A place in the plane of an outline.
pub type Flat = [f64; 2];

/// A mesh that solids are added to.
#[derive(Default)]
pub struct Solids {
    mesh: TriangleMesh,
}

impl Solids {
    /// Begins with a mesh of one colour.
    pub fn of(mut mesh: TriangleMesh, colour: impl Fn([f64; 3]) -> [u8; 3]) -> Self {
        mesh.colours = mesh.positions.iter().map(|&p| colour(p)).collect();
        Self { mesh }
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Computes the normals; edges of more than the angle with this cosine are sharp.
    pub fn finish(mut self, crease_cos: f64) -> TriangleMesh {
        computed(&mut self.mesh, crease_cos);
        self.mesh
    }

    fn vertex(&mut self, position: [f64; 3], colour: [u8; 3]) -> u32 {
        self.mesh.positions.push(position);
        self.mesh.colours.push(colour);
        self.mesh.positions.len() as u32 - 1
    }

    /// Adds two triangles; the corners are counter-clockwise seen from outside.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }

    /// Adds a box between two corners.
    pub fn block(&mut self, low: [f64; 3], high: [f64; 3], colour: [u8; 3]) {
        let corner = |i: usize| [0, 1, 2].map(|a| if i >> a & 1 == 0 { low[a] } else { high[a] });
        let at: Vec<u32> = (0..8).map(|i| self.vertex(corner(i), colour)).collect();
        for face in
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
        {
            self.quad(face.map(|i: usize| at[i]));
        }
    }

    /// Adds the solid between two outlines of equal length, extruded from one depth to another:
    /// an arch, a vault, or, if `is_ring`, a slab with a hole. `place` maps an outline's place and
    /// a depth to space and must keep orientation; the outlines run so that `inner` lies on their
    /// left.
    pub fn band(
        &mut self,
        [outer, inner]: [&[Flat]; 2],
        is_ring: bool,
        depths: [f64; 2],
        place: impl Fn(Flat, f64) -> [f64; 3],
        colour: [u8; 3],
    ) {
        let n = outer.len().min(inner.len());
        let mut row = |outline: &[Flat], depth: f64| -> Vec<u32> {
            outline[..n].iter().map(|&f| self.vertex(place(f, depth), colour)).collect()
        };
        let [low_out, high_out] = depths.map(|d| row(outer, d));
        let [low_in, high_in] = depths.map(|d| row(inner, d));
        for i in 0..if is_ring { n } else { n - 1 } {
            let j = (i + 1) % n;
            self.quad([low_out[i], low_out[j], high_out[j], high_out[i]]);
            self.quad([low_in[j], low_in[i], high_in[i], high_in[j]]);
            self.quad([high_out[i], high_out[j], high_in[j], high_in[i]]);
            self.quad([low_out[j], low_out[i], low_in[i], low_in[j]]);
        }
        if !is_ring {
            let e = n - 1;
            self.quad([low_out[0], high_out[0], high_in[0], low_in[0]]);
            self.quad([high_out[e], low_out[e], low_in[e], high_in[e]]);
        }
    }

    /// Adds a solid of revolution about a vertical axis through `centre`: `profile` holds radius
    /// and height from below to above, and is closed by flat ends. `shape` is the factor of the
    /// radius at a part of the turn (0 to 1) and a place of the profile.
    pub fn revolve(
        &mut self,
        centre: Flat,
        profile: &[Flat],
        around: usize,
        shape: impl Fn(f64, usize) -> f64,
        colour: [u8; 3],
    ) {
        let mut rings = Vec::with_capacity(profile.len());
        for (i, &[radius, z]) in profile.iter().enumerate() {
            let ring: Vec<u32> = (0..around)
                .map(|k| {
                    let turn = k as f64 / around as f64;
                    let (s, c) = libm::sincos(turn * std::f64::consts::TAU);
                    let r = radius * shape(turn, i);
                    self.vertex([centre[0] + c * r, centre[1] + s * r, z], colour)
                })
                .collect();
            rings.push(ring);
        }
        for pair in rings.windows(2) {
            for k in 0..around {
                let l = (k + 1) % around;
                self.quad([pair[0][k], pair[0][l], pair[1][l], pair[1][k]]);
            }
        }
        let ends = [profile.first().zip(rings.first()), profile.last().zip(rings.last())];
        for (is_top, end) in ends.into_iter().enumerate() {
            let Some((&[_, z], ring)) = end else { continue };
            let middle = self.vertex([centre[0], centre[1], z], colour);
            for k in 0..around {
                let (a, b) = (ring[k], ring[(k + 1) % around]);
                let cap = if is_top == 1 { [middle, a, b] } else { [middle, b, a] };
                self.mesh.triangles.push(cap);
            }
        }
    }
}
