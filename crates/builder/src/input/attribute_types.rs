//! Attributes of one name in several inputs: where the inputs do not tell their types (text), they
//! get one type that holds the values of all. What stays apart under one name is noted.

use esker_format::Metadata;
use esker_points::{AttrType, Schema};
use esker_scan::Source;
use std::collections::BTreeMap;

/// Gives attributes of one name one type in all `sources`, as far as their types follow from values
/// alone: that of the inputs which tell their type, if it holds all values, else the narrowest that
/// does.
pub fn join_types(sources: &mut [Box<dyn Source>]) {
    let mut told: BTreeMap<String, Vec<AttrType>> = BTreeMap::new();
    let mut chosen: BTreeMap<String, Vec<AttrType>> = BTreeMap::new();
    for source in sources.iter() {
        let by_values = source.typed_by_values();
        for (i, attribute) in source.info().schema.attributes.iter().enumerate() {
            let of = if by_values.contains(&i) { &mut chosen } else { &mut told };
            let types = of.entry(attribute.name.clone()).or_default();
            if !types.contains(&attribute.ty) {
                types.push(attribute.ty);
            }
        }
    }
    let wanted: BTreeMap<String, AttrType> = chosen
        .into_iter()
        .filter_map(|(name, types)| {
            let widest = types.iter().copied().map(Some).reduce(|a, b| a?.wider(b?))??;
            let told = told.get(&name).map_or(&[][..], Vec::as_slice);
            let ty = match told {
                &[ty] if ty.wider(widest) == Some(ty) => ty,
                _ => widest,
            };
            Some((name, ty))
        })
        .collect();
    for source in sources {
        widen(source, |name, _| wanted.get(name).copied());
    }
}

/// Gives the attributes of a source the types that they have among `recorded`, those of a file that
/// was built from it.
pub fn take_types(source: &mut Box<dyn Source>, recorded: &Schema, present: &[u16]) {
    let of_file = || present.iter().filter_map(|&i| recorded.attributes.get(usize::from(i)));
    widen(source, |name, ty| {
        let types = || of_file().filter(|a| a.name == name).map(|a| a.ty);
        let is_there = types().any(|recorded| recorded == ty);
        if is_there { None } else { types().find(|wide| wide.wider(ty) == Some(*wide)) }
    });
}

fn widen(source: &mut Box<dyn Source>, wanted: impl Fn(&str, AttrType) -> Option<AttrType>) {
    let schema = source.info().schema.clone();
    for i in source.typed_by_values() {
        let attribute = &schema.attributes[i];
        let is_only = schema.attributes.iter().filter(|a| a.name == attribute.name).count() == 1;
        let wide =
            wanted(&attribute.name, attribute.ty).filter(|&ty| is_only && ty != attribute.ty);
        if let Some(ty) = wide.filter(|ty| ty.wider(attribute.ty) == Some(*ty)) {
            source.widen(i, ty);
        }
    }
}

/// Path of the source, name and type of each attribute of each source of a file.
pub fn of_metadata(metadata: &Metadata) -> impl Iterator<Item = (String, String, AttrType)> {
    metadata.sources.iter().flat_map(|source| {
        let class = metadata.classes.get(usize::from(source.class));
        let present = class.map_or(&[][..], |class| &class.present);
        let attributes = present.iter().filter_map(|&i| metadata.schema.attributes.get(i as usize));
        attributes.map(|a| (source.path.clone(), a.name.clone(), a.ty))
    })
}

/// A note on attributes that sources have under one name, but with different types. In: path of the
/// source, name and type of each.
pub fn note_apart(of_sources: impl Iterator<Item = (String, String, AttrType)>) -> Option<String> {
    let mut of_name: BTreeMap<String, Vec<(AttrType, String)>> = BTreeMap::new();
    for (path, name, own) in of_sources {
        let types = of_name.entry(name).or_default();
        if types.iter().all(|(ty, _)| *ty != own) {
            types.push((own, path));
        }
    }
    let apart: Vec<String> = of_name
        .iter()
        .filter(|(_, types)| types.len() > 1)
        .map(|(name, types)| {
            let each: Vec<_> =
                types.iter().map(|(ty, path)| format!("{} in {path}", ty.name())).collect();
            format!("{name} ({})", each.join(", "))
        })
        .collect();
    (!apart.is_empty()).then(|| {
        format!("attributes of one name and different types stay apart: {}", apart.join("; "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wider_type_holds_both() {
        use AttrType::{F32, F64, I8, I32, I64, U8, U16, U64};
        for (a, b, want) in [
            (U8, U16, Some(U16)),
            (U16, I32, Some(I32)),
            (U8, I8, Some(AttrType::I16)),
            (U16, F32, Some(F32)),
            (I32, F32, Some(F64)),
            (F32, F64, Some(F64)),
            (I32, I64, Some(I64)),
            (U64, I32, None),
            (U64, F64, None),
        ] {
            assert_eq!(a.wider(b), want, "{a:?} {b:?}");
            assert_eq!(b.wider(a), want, "{a:?} {b:?}");
            assert_eq!(a.wider(a), Some(a));
        }
    }
}
