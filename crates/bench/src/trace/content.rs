//! Names references by what they depend on: a hash of the surfaces, the camera, the lights and the
//! settings, so that a reference is never compared with a picture of something else.

use esker_render::Splat;
use esker_scan::mesh::TriangleMesh;
use std::fmt::Debug;

/// A hash of 64-bit words: FNV-1a over words, with the bits of each word mixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Content(u64);

impl Default for Content {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Content {
    fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        self.0 ^= self.0 >> 29;
    }

    /// Adds the text of a value; values that differ must have different texts.
    pub fn add(mut self, value: &impl Debug) -> Self {
        format!("{value:?}").bytes().for_each(|b| self.word(u64::from(b)));
        self.word(u64::MAX);
        self
    }

    /// Adds a mesh.
    pub fn add_mesh(mut self, mesh: &TriangleMesh) -> Self {
        mesh.positions.as_flattened().iter().for_each(|c| self.word(c.to_bits()));
        mesh.normals.as_flattened().iter().for_each(|c| self.word(u64::from(c.to_bits())));
        mesh.colours.as_flattened().iter().for_each(|&c| self.word(u64::from(c)));
        mesh.triangles.as_flattened().iter().for_each(|&v| self.word(u64::from(v)));
        self
    }

    /// Adds splats.
    pub fn add_splats(mut self, splats: &[Splat]) -> Self {
        for splat in splats {
            let Splat { centre, radius, normal, colour, .. } = splat;
            for c in [centre, normal, colour].into_iter().flatten().chain([radius]) {
                self.word(u64::from(c.to_bits()));
            }
        }
        self
    }

    /// The hash as it stands in names of files.
    pub fn name(self) -> String {
        format!("{:016x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_change_gives_another_name() {
        let mesh = TriangleMesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            ..Default::default()
        };
        let name =
            |mesh: &TriangleMesh, value: u32| Content::default().add_mesh(mesh).add(&value).name();
        let own = name(&mesh, 1);
        assert_eq!(own, name(&mesh.clone(), 1));
        assert_ne!(own, name(&mesh, 2));
        let mut other = mesh.clone();
        other.positions[1][0] = 1.0 + f64::EPSILON;
        assert_ne!(own, name(&other, 1));
        let mut other = mesh;
        other.triangles[0] = [0, 2, 1];
        assert_ne!(own, name(&other, 1));
    }
}
