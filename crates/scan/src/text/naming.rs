//! What columns of a text file and properties of a PLY vertex are called in Esker: coordinates,
//! normals, colours and intensity by their usual names, all else by its own.

use esker_points::attribute::names;
use esker_points::{AttrType, Attribute, Batch, Schema};
use std::sync::Arc;

/// Bytes of a name at most.
pub(crate) const NAME_BYTES_MAX: usize = 256;
/// Columns or properties at most.
pub(crate) const COLUMNS_MAX: usize = 1024;
/// Why points without a place are refused.
pub(crate) const NOT_FINITE: &str = "coordinate is not a finite number";

/// 0, 1, 2 for x, y, z.
pub(crate) fn axis(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|a| name.eq_ignore_ascii_case(a))
}

/// Where x, y and z are among these names.
pub(crate) fn axes<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<[usize; 3]> {
    let at = |i| names.clone().position(|n| axis(n) == Some(i));
    Some([at(0)?, at(1)?, at(2)?])
}

/// The name that an attribute of this name may get, whatever its type.
pub(crate) fn usual(name: &str) -> Option<&'static str> {
    Some(match name.to_ascii_lowercase().as_str() {
        "nx" | "normal_x" | "normalx" => names::NX,
        "ny" | "normal_y" | "normaly" => names::NY,
        "nz" | "normal_z" | "normalz" => names::NZ,
        "red" | "r" | "diffuse_red" => names::RED,
        "green" | "g" | "diffuse_green" => names::GREEN,
        "blue" | "b" | "diffuse_blue" => names::BLUE,
        "alpha" | "a" | "diffuse_alpha" => "alpha",
        "intensity" | "scalar_intensity" => names::INTENSITY,
        _ => return None,
    })
}

/// The name of an attribute of this source name and type: [`usual`] where the type is usual for it too
/// (a normal is floating, a colour has 8 or 16 bits), else its own.
pub(crate) fn name_of(name: &str, ty: AttrType) -> String {
    let fits = |usual: &str| match usual {
        names::NX | names::NY | names::NZ => matches!(ty, AttrType::F32 | AttrType::F64),
        names::INTENSITY => true,
        _ => matches!(ty, AttrType::U8 | AttrType::U16),
    };
    usual(name).filter(|u| fits(u)).unwrap_or(name).to_owned()
}

/// The schema of these names and types, and which of its columns each has become. Of two attributes
/// that are alike the later one gets a number behind its name.
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

/// The columns of 16-bit colours, where the schema has such.
pub(crate) fn wide_colours(schema: &Schema) -> Option<[usize; 3]> {
    schema.rgb().filter(|rgb| schema.attributes[rgb[0]].ty == AttrType::U16)
}

/// The greatest value in the 16-bit colour columns of a batch; 0 where there are none.
pub(crate) fn colour_max(batch: &Batch) -> u16 {
    let columns = wide_colours(&batch.schema).into_iter().flatten();
    let values = columns.flat_map(|c| batch.columns[c].chunks_exact(2));
    values.map(|v| u16::from_le_bytes([v[0], v[1]])).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_names_need_the_usual_type() {
        assert_eq!(name_of("R", AttrType::U8), "red");
        assert_eq!(name_of("r", AttrType::F32), "r");
        assert_eq!(name_of("Normal_X", AttrType::F32), "nx");
        assert_eq!(name_of("scalar_Intensity", AttrType::F32), "intensity");
        assert_eq!(name_of("Scan", AttrType::U8), "Scan");
    }

    #[test]
    fn attributes_that_are_alike_are_all_kept() {
        let attributes = ["red", "b", "red", "red"].map(|n| (n.to_owned(), AttrType::U8)).to_vec();
        let (schema, columns) = schema_of(attributes);
        let names: Vec<_> = columns.iter().map(|&c| schema.attributes[c].name.as_str()).collect();
        assert_eq!(names, ["red", "b", "red#2", "red#3"]);
    }
}
