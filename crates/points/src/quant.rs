//! Quantised planes: hot positions and their residuals, radii, normals. Both directions are here,
//! so that builder, renderer and tests agree.

/// Bytes of a point in the hot position plane: three `u16`, a radius code of 8 bits, a zero byte.
pub const HOT_POSITION_BYTES: usize = 8;
/// Offset of the zero byte. Planes that are filtered while they are loaded have another value there
/// for unwanted points; no file has.
pub const HIDDEN_AT: usize = 7;
/// Offset of a colour's index in compact planes, in place of the zero byte.
pub const INDEX_AT: usize = 7;
/// Offset of the radius code in a hot position.
pub const RADIUS_AT: usize = 6;

/// The least number of dropped bits with which a box of this extent (steps, longest axis) fits
/// `u16`.
pub fn hot_shift(extent_steps: u32) -> u8 {
    (32 - extent_steps.leading_zeros()).saturating_sub(16) as u8
}

/// Hot coordinate of a lattice coordinate.
pub fn hot(c: u32, box_min: u32, shift: u8) -> u16 {
    ((c - box_min) >> shift) as u16
}

/// Dropped bits of a lattice coordinate.
pub fn residual(c: u32, box_min: u32, shift: u8) -> u16 {
    ((c - box_min) & ((1 << shift) - 1)) as u16
}

/// Lattice coordinate of a hot coordinate and its residual.
pub fn exact(q: u16, residual: u16, box_min: u32, shift: u8) -> u32 {
    box_min.wrapping_add((u32::from(q) << shift) | u32::from(residual))
}

/// Bytes of a point in the residual plane: none, one `u32` of 10-10-10 bits, or three `u16`.
pub fn residual_bytes(shift: u8) -> usize {
    match shift {
        0 => 0,
        1..=10 => 4,
        _ => 6,
    }
}

/// Appends a point's dropped bits.
pub fn push_residual(residual: [u16; 3], shift: u8, out: &mut Vec<u8>) {
    match residual_bytes(shift) {
        0 => {}
        4 => {
            let [x, y, z] = residual.map(u32::from);
            out.extend_from_slice(&(x | y << 10 | z << 20).to_le_bytes());
        }
        _ => residual.iter().for_each(|r| out.extend_from_slice(&r.to_le_bytes())),
    }
}

/// Reads a point's dropped bits.
///
/// # Panics
/// If `plane` is shorter than point `index` needs.
pub fn read_residual(plane: &[u8], index: usize, shift: u8) -> [u16; 3] {
    match residual_bytes(shift) {
        0 => [0; 3],
        4 => {
            let b = &plane[index * 4..][..4];
            let v = u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            [v & 1023, v >> 10 & 1023, v >> 20 & 1023].map(|c| c as u16)
        }
        _ => [0, 1, 2].map(|i| {
            let b = &plane[index * 6 + i * 2..][..2];
            u16::from_le_bytes([b[0], b[1]])
        }),
    }
}

/// Greatest relative excess of a code's radius over the exact one, for radii from 1/256 to 245
/// spacings, to which codes are limited.
pub const RADIUS_ERROR: f64 = 0.0444;
/// Greatest radius that codes hold, in units of the node's spacing.
pub const RADIUS_MAX: f64 = 245.0;
/// Greatest code of a radius that is scaled with the spacing that is drawn around its point.
/// Greater ones, of over 8 spacings, stand for the radius itself: such a point is in a sparse part
/// beside a dense one, and no finer node is drawn between it and its neighbours.
pub const SCALED_CODE_MAX: u8 = 176;
/// Greatest rotation of a normal by its code, degrees.
pub const NORMAL_ERROR_DEGREES: f64 = 0.004;

/// Code of a radius: sixteenths of an octave relative to the node's spacing, rounded up (a covering
/// radius must not shrink).
pub fn radius_code(radius: f64, spacing: f64) -> u8 {
    if !(radius > 0.0 && spacing > 0.0) {
        return 0;
    }
    ((radius / spacing).log2() * 16.0 + 128.0 - 1e-9).ceil().clamp(0.0, 255.0) as u8
}

/// Radius of a code, in units of the node's spacing.
pub fn radius_factor(code: u8) -> f32 {
    ((f32::from(code) - 128.0) / 16.0).exp2()
}

/// Encodes a unit vector as two `i16` on the octahedron (meyer2010). A zero or non-finite vector
/// gives (-32768, -32768), which [`oct_decode`] returns as zero.
pub fn oct_encode(n: [f32; 3]) -> [i16; 2] {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return [i16::MIN; 2];
    }
    let (x, y) = (n[0] / sum, n[1] / sum);
    let folded = if n[2] < 0.0 {
        [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)]
    } else {
        [x, y]
    };
    folded.map(|c| (c * 32767.0).round() as i16)
}

/// Unit vector of an octahedral code; zero for "none".
pub fn oct_decode(code: [i16; 2]) -> [f32; 3] {
    let [x, y, z] = oct_direction(code);
    let norm = (x * x + y * y + z * z).sqrt();
    if norm == 0.0 { [0.0; 3] } else { [x / norm, y / norm, z / norm] }
}

/// Direction of an octahedral code, not of unit length: enough to determine sides. Zero for "none".
pub fn oct_direction(code: [i16; 2]) -> [f32; 3] {
    if code == [i16::MIN; 2] {
        return [0.0; 3];
    }
    let [x, y] = code.map(|c| (f32::from(c) / 32767.0).max(-1.0));
    let z = 1.0 - x.abs() - y.abs();
    if z < 0.0 { [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y), z] } else { [x, y, z] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sixteen_bits_are_dropped_only_when_needed() {
        assert_eq!(hot_shift(0), 0);
        assert_eq!(hot_shift(65_535), 0);
        assert_eq!(hot_shift(65_536), 1);
        assert_eq!(hot_shift(u32::MAX), 16);
    }

    #[test]
    fn radii_of_over_eight_spacings_are_not_scaled() {
        assert_eq!(radius_code(8.0 * 0.37, 0.37), SCALED_CODE_MAX);
        assert!(radius_code(8.1, 1.0) > SCALED_CODE_MAX);
        assert_eq!(radius_code(RADIUS_MAX, 1.0), u8::MAX);
    }

    #[test]
    fn no_normal_stays_no_normal() {
        assert_eq!(oct_decode(oct_encode([0.0; 3])), [0.0; 3]);
        assert_eq!(oct_decode(oct_encode([f32::NAN, 0.0, 1.0])), [0.0; 3]);
    }

    proptest! {
        #[test]
        fn hot_and_residual_are_the_exact_coordinate(min: u32, extent: u32, t: u32) {
            let extent = extent.min(u32::MAX - min);
            let c = min + if extent == u32::MAX { t } else { t % (extent + 1) };
            let s = hot_shift(extent);
            let (q, r) = (hot(c, min, s), residual(c, min, s));
            prop_assert_eq!(exact(q, r, min, s), c);
            let mut plane = Vec::new();
            push_residual([r, 0, r], s, &mut plane);
            prop_assert_eq!(plane.len(), residual_bytes(s));
            prop_assert_eq!(read_residual(&plane, 0, s), [r, 0, r]);
        }

        #[test]
        fn radii_never_shrink_and_grow_by_at_most_a_sixteenth_of_an_octave(radius in 1e-3f64..100.0) {
            let back = f64::from(radius_factor(radius_code(radius, 1.0)));
            prop_assert!(back >= radius * 0.99999 && back <= radius * (1.0 + RADIUS_ERROR) || radius < 0.0039);
        }

        #[test]
        fn normals_turn_by_no_more_than_the_bound(v in [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0]) {
            let norm = v.iter().map(|c| c * c).sum::<f32>().sqrt();
            prop_assume!(norm > 1e-3);
            let n = v.map(|c| c / norm);
            let back = oct_decode(oct_encode(n));
            let cross = [n[1] * back[2] - n[2] * back[1], n[2] * back[0] - n[0] * back[2], n[0] * back[1] - n[1] * back[0]];
            let sine = f64::from(cross.iter().map(|c| c * c).sum::<f32>().sqrt());
            prop_assert!(sine <= NORMAL_ERROR_DEGREES.to_radians(), "{}", sine.to_degrees());
        }
    }
}
