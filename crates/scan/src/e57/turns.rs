//! Rotations of the scans of an E57 file, from the XML that an `.esker` file keeps of it: they tell
//! which axis is vertical. ASTM E2807, section 8.4: the pose of a scan has a unit quaternion.

use super::xml;
use roxmltree::{Document, Node};

/// Name of the block with the XML of an E57 file among those that are kept of a source.
pub(super) const XML_BLOCK: &str = "E57 XML";

/// Rotation of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Axis, unit length, in the file's coordinates. Of the two directions either may be meant.
    pub axis: [f64; 3],
    /// Angle around it, radians, 0 to pi.
    pub angle: f64,
}

impl Turn {
    /// The rotation of a quaternion `w, x, y, z` of any length; `None` if it is none.
    fn of([w, x, y, z]: [f64; 4]) -> Option<Self> {
        let side = (x * x + y * y + z * z).sqrt();
        let length = side.hypot(w);
        if !(length.is_finite() && length > 0.0) {
            return None;
        }
        let axis = if side > 0.0 { [x, y, z].map(|c| c / side) } else { [0.0, 0.0, 1.0] };
        Some(Self { axis, angle: 2.0 * side.atan2(w.abs()) })
    }
}

/// Rotations of the scans of a source, from the blocks that are kept of it; empty if the source is
/// no E57 file, or gives its scans no rotations.
pub fn turns(verbatim: &[(String, Vec<u8>)]) -> Vec<Turn> {
    let block = verbatim.iter().find(|(name, _)| name == XML_BLOCK);
    // The block is checked again, since an `.esker` file may be damaged.
    let text = block.filter(|(_, bytes)| xml::check(bytes).is_ok());
    let text = text.and_then(|(_, bytes)| std::str::from_utf8(bytes).ok());
    let document = text.and_then(|text| Document::parse(text).ok());
    let Some(document) = &document else { return Vec::new() };
    let rotations = document.descendants().filter(|node| is_rotation_of_scan(*node));
    rotations.filter_map(rotation).collect()
}

/// Whether an element is the rotation of a scan, not that of an image.
fn is_rotation_of_scan(node: Node<'_, '_>) -> bool {
    let mut around = node.ancestors().filter(Node::is_element).map(|n| n.tag_name().name());
    let names: [Option<&str>; 4] = std::array::from_fn(|_| around.next());
    names == [Some("rotation"), Some("pose"), Some("vectorChild"), Some("data3D")]
}

fn rotation(node: Node<'_, '_>) -> Option<Turn> {
    let part = |name: &str| {
        let is_it = |child: &Node<'_, '_>| child.is_element() && child.tag_name().name() == name;
        let part = node.children().find(is_it)?;
        // An empty element stands for 0.
        part.text().map_or(Some(0.0), |text| text.trim().parse::<f64>().ok())
    };
    Turn::of([part("w")?, part("x")?, part("y")?, part("z")?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(scans: &[[&str; 4]]) -> Vec<(String, Vec<u8>)> {
        let scan = |[w, x, y, z]: &[&str; 4]| {
            let part = |name: &str, value: &str| match value {
                "" => format!("<{name} type=\"Float\"/>"),
                value => format!("<{name} type=\"Float\">{value}</{name}>"),
            };
            let [w, x, y, z] = [("w", w), ("x", x), ("y", y), ("z", z)].map(|(n, v)| part(n, v));
            format!("<vectorChild><pose><rotation>{w}{x}{y}{z}</rotation></pose></vectorChild>")
        };
        let scans: String = scans.iter().map(scan).collect();
        let space = "xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\"";
        let image = "<images2D><vectorChild><pose><rotation><w>0</w><x>1</x><y>0</y><z>0</z></rotation></pose></vectorChild></images2D>";
        let text = format!("<e57Root {space}><data3D>{scans}</data3D>{image}</e57Root>");
        vec![(XML_BLOCK.into(), text.into_bytes())]
    }

    #[test]
    fn rotations_of_scans_are_read_and_those_of_images_are_not() {
        let half = std::f64::consts::FRAC_1_SQRT_2.to_string();
        let all = turns(&file(&[["1", "", "", ""], [&half, "0", &half, "0"], ["0", "", "", "-2"]]));
        assert_eq!(all.len(), 3);
        assert_eq!(all[0].angle, 0.0);
        assert!((all[1].angle - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((all[1].axis[1] - 1.0).abs() < 1e-12);
        assert_eq!((all[2].axis, all[2].angle), ([0.0, 0.0, -1.0], std::f64::consts::PI));
    }

    #[test]
    fn damaged_blocks_have_no_rotations() {
        for bytes in [&b"<e57Root><data3D>"[..], b"\xff\xfe", b"", b"<a/>"] {
            assert_eq!(turns(&[(XML_BLOCK.into(), bytes.to_vec())]), []);
        }
        assert_eq!(turns(&file(&[["0", "0", "0", "0"], ["nan", "0", "0", "1"]])), []);
        assert_eq!(turns(&[("las header".into(), Vec::new())]), []);
    }
}
