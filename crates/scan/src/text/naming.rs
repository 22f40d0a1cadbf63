//! Names the attributes made from columns of a text file and properties of a PLY vertex:
//! coordinates, normals, colours and intensity get Esker's names, all others keep their own.

use crate::fields::names::{ALPHA, Meaning, meaning};
use esker_points::attribute::names;
use esker_points::{AttrType, Attribute, Batch, Schema};
use std::sync::Arc;

/// Greatest length of a name, in bytes.
pub(crate) const NAME_BYTES_MAX: usize = 256;
/// Greatest number of columns or properties.
pub(crate) const COLUMNS_MAX: usize = 1024;
/// Reason for which points without a position are refused.
pub(crate) const NOT_FINITE: &str = "coordinate is not a finite number";
/// Reason for which directions without a return are refused.
pub(crate) const NO_RETURN: &str = "no return";

/// 0, 1, 2 for x, y, z.
pub(crate) fn axis(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|a| name.eq_ignore_ascii_case(a))
}

/// Indices of x, y and z among these names.
pub(crate) fn axes<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<[usize; 3]> {
    let at = |i| names.clone().position(|n| axis(n) == Some(i));
    Some([at(0)?, at(1)?, at(2)?])
}

/// Esker's name of an attribute with this name, whatever its type, if it is stored as a whole.
pub(crate) fn usual(name: &str) -> Option<&'static str> {
    match meaning(name) {
        Some(Meaning::Field(name)) => Some(name),
        _ => None,
    }
}

/// Whether an attribute of one of Esker's names may have this type.
fn fits(usual: &str, ty: AttrType) -> bool {
    match usual {
        names::INTENSITY => true,
        names::NX | names::NY | names::NZ => matches!(ty, AttrType::F32 | AttrType::F64),
        names::RED | names::GREEN | names::BLUE | ALPHA => {
            matches!(ty, AttrType::U8 | AttrType::U16)
        }
        names::NIR | names::POINT_SOURCE_ID => ty == AttrType::U16,
        names::GPS_TIME => ty == AttrType::F64,
        _ => ty == AttrType::U8,
    }
}

/// Names attributes with these names and types: [`usual`] if the type is usual for that name, too,
/// else their own. Red, green and blue are colours only if all three exist, alpha only beside them.
pub(crate) fn named(attributes: &[(&str, AttrType)]) -> Vec<(String, AttrType)> {
    let usual: Vec<_> =
        attributes.iter().map(|&(name, ty)| usual(name).filter(|u| fits(u, ty))).collect();
    let colours = [names::RED, names::GREEN, names::BLUE];
    let are_colours = colours.iter().all(|c| usual.contains(&Some(c)));
    let is_colour = |name: &str| colours.contains(&name) || name == ALPHA;
    let name = |(&(own, ty), usual): (&(&str, AttrType), Option<&str>)| {
        let usual = usual.filter(|u| are_colours || !is_colour(u));
        (usual.unwrap_or(own).to_owned(), ty)
    };
    attributes.iter().zip(usual).map(name).collect()
}

/// Makes the schema of these names and types, and returns the column of each. Of two attributes of
/// equal name and type, the later one gets a number after its name.
pub(crate) fn schema_of(attributes: Vec<(String, AttrType)>) -> (Arc<Schema>, Vec<usize>) {
    let mut seen = std::collections::HashSet::new();
    let unique = attributes.into_iter().map(|(base, ty)| {
        let (mut name, mut n) = (base.clone(), 2);
        while !seen.insert((name.clone(), ty)) {
            name = format!("{base}#{n}");
            n += 1;
        }
        (name, ty)
    });
    let unique: Vec<_> = unique.collect();
    let schema = Schema::new(unique.iter().map(|(n, ty)| Attribute::new(n, *ty)).collect());
    let columns = unique.iter().filter_map(|(n, ty)| schema.find_typed(n, *ty)).collect();
    (Arc::new(schema), columns)
}

/// Indices of the columns of 16-bit colours, if the schema has them.
pub(crate) fn wide_colours(schema: &Schema) -> Option<[usize; 3]> {
    schema.rgb().filter(|rgb| schema.attributes[rgb[0]].ty == AttrType::U16)
}

/// The greatest value in the 16-bit colour columns of a batch; 0 without such columns.
pub(crate) fn colour_max(batch: &Batch) -> u16 {
    let columns = wide_colours(&batch.schema).into_iter().flatten();
    let values = columns.flat_map(|c| batch.columns[c].chunks_exact(2));
    values.map(|v| u16::from_le_bytes([v[0], v[1]])).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_of(attributes: &[(&str, AttrType)]) -> Vec<String> {
        named(attributes).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn usual_names_need_the_usual_type() {
        for (name, ty, want) in [
            ("Normal_X", AttrType::F32, "nx"),
            ("scalar_Intensity", AttrType::F32, "intensity"),
            ("Classification", AttrType::U8, "classification"),
            ("CLASSIFICATION", AttrType::F32, "CLASSIFICATION"),
            ("GPS_Time", AttrType::F64, "gps_time"),
            ("GpsTime", AttrType::F64, "gps_time"),
            ("Gps Time", AttrType::I32, "Gps Time"),
            ("PointSourceId", AttrType::U16, "point_source_id"),
            ("UserData", AttrType::U8, "user_data"),
            // Packed in LAS, and of another unit.
            ("ReturnNumber", AttrType::U8, "ReturnNumber"),
            ("ScanAngle", AttrType::I16, "ScanAngle"),
            ("Scan", AttrType::U8, "Scan"),
        ] {
            assert_eq!(names_of(&[(name, ty)]), [want]);
        }
    }

    #[test]
    fn colours_are_three_and_alpha_stands_beside_them() {
        let of = |names: &[&str], ty| {
            names_of(&names.iter().map(|n| (*n, ty)).collect::<Vec<_>>()).join(" ")
        };
        assert_eq!(of(&["R", "G", "b", "a"], AttrType::U8), "red green blue alpha");
        assert_eq!(of(&["Red", "GREEN", "diffuse_blue"], AttrType::U16), "red green blue");
        for alone in ["b", "a", "r g", "Red", "g b a"] {
            let names: Vec<&str> = alone.split(' ').collect();
            assert_eq!(of(&names, AttrType::U8), alone);
        }
        assert_eq!(of(&["R", "G", "B", "A"], AttrType::F32), "R G B A");
    }

    #[test]
    fn attributes_that_are_alike_are_all_kept() {
        let attributes = ["red", "b", "red", "red"].map(|n| (n.to_owned(), AttrType::U8)).to_vec();
        let (schema, columns) = schema_of(attributes);
        let names: Vec<_> = columns.iter().map(|&c| schema.attributes[c].name.as_str()).collect();
        assert_eq!(names, ["red", "b", "red#2", "red#3"]);
    }
}
