//! Makes names of columns unique, because most programs refuse a file with two columns of one name.

use esker_points::AttrType;

/// Makes names of at most `bytes_max` bytes for columns of `wanted` names and types. A name that is
/// `taken` or equals an earlier one gets its type as a suffix, or else a number. Also returns a
/// note on changed names, if there are any.
pub fn unique(
    wanted: &[(String, AttrType)],
    taken: &[&str],
    bytes_max: usize,
) -> (Vec<String>, Vec<String>) {
    let mut names: Vec<String> = Vec::with_capacity(wanted.len());
    let (mut renamed, mut cut) = (Vec::new(), Vec::new());
    for (wanted, ty) in wanted {
        let end = |end: &str| {
            let room = bytes_max.saturating_sub(end.len());
            format!("{}{end}", &wanted[..wanted.floor_char_boundary(room)])
        };
        let numbers = (2..).map(|n: u32| format!("_{n}"));
        let ends = [String::new(), format!("_{}", ty.name())].into_iter().chain(numbers);
        let is_free = |name: &String| !taken.contains(&name.as_str()) && !names.contains(name);
        let name = ends.map(|e| end(&e)).find(is_free).unwrap_or_default();
        if name != end("") {
            renamed.push(format!("{wanted} ({}) as {name}", ty.name()));
        } else if name != *wanted {
            cut.push(format!("`{wanted}` to `{name}`"));
        }
        names.push(name);
    }
    let note = || format!("their names are taken: {}", renamed.join(", "));
    let taken = (!renamed.is_empty()).then(note);
    let cut_note = || format!("names of over {bytes_max} bytes are cut: {}", cut.join(", "));
    let notes = taken.into_iter().chain((!cut.is_empty()).then(cut_note)).collect();
    (names, notes)
}

/// A note on names that a format does not hold as they are: pairs of a name and what is written in
/// its place.
pub fn note_renamed<'a>(pairs: impl Iterator<Item = (&'a str, &'a str)>) -> Option<String> {
    let changed = pairs.filter(|(own, new)| own != new);
    let all: Vec<String> = changed.map(|(own, new)| format!("`{own}` to `{new}`")).collect();
    (!all.is_empty()).then(|| format!("renamed: {}", all.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn taken_names_get_their_type_as_a_suffix_then_a_number() {
        let wanted =
            [("x", AttrType::F32), ("a", AttrType::U8), ("a", AttrType::U16), ("a", AttrType::U16)];
        let wanted = wanted.map(|(name, ty)| (name.to_owned(), ty));
        let (names, notes) = unique(&wanted, &["x"], 32);
        assert_eq!(names, ["x_f32", "a", "a_u16", "a_2"]);
        assert_eq!(
            notes,
            ["their names are taken: x (f32) as x_f32, a (u16) as a_u16, a (u16) as a_2"]
        );
    }

    proptest! {
        #[test]
        fn names_are_short_and_unique(wanted in prop::collection::vec("[aé_2]{0,9}", 0..40), bytes_max in 6usize..12) {
            let wanted: Vec<_> = wanted.into_iter().map(|name| (name, AttrType::U8)).collect();
            let (names, _) = unique(&wanted, &["a", "é"], bytes_max);
            let mut once = names.clone();
            once.sort();
            once.dedup();
            prop_assert_eq!(once.len(), wanted.len());
            prop_assert!(names.iter().all(|n| n.len() <= bytes_max && n != "a" && n != "é"));
        }
    }
}
