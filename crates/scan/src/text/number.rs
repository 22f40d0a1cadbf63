//! Parses numbers in text: the fields of a line, the value of a field, and the number of decimals
//! that writes it exactly. Values are rounded correctly to the nearest `f64` (crate `fast-float2`).

/// The fields of a line: separated by blanks and tabs, with at most one comma or semicolon among
/// them. Two commas in a row enclose an empty field; one at the end of the line is ignored.
pub(crate) fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = line.trim_ascii();
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let separates = |b: &u8| matches!(b, b',' | b';') || b.is_ascii_whitespace();
        let end = rest.iter().position(separates).unwrap_or(rest.len());
        let (field, after) = rest.split_at(end);
        rest = after.trim_ascii_start();
        if let [b',' | b';', after @ ..] = rest {
            rest = after.trim_ascii_start();
        }
        Some(field)
    })
}

/// The value of a field, with or without quotes; `None` if it is no number. The spellings of NaN
/// and infinity by C libraries (`nan(ind)`, `1.#QNAN`, `-1.#INF`) are read as such.
pub(crate) fn number(field: &[u8]) -> Option<f64> {
    fast_float2::parse::<f64, _>(field).ok().or_else(|| {
        let field = unquoted(field);
        if let Ok(quoted) = fast_float2::parse(field) {
            return Some(quoted);
        }
        let plain = field.strip_prefix(b"-").or(field.strip_prefix(b"+")).unwrap_or(field);
        let c_nan = plain.len() >= 4 && plain[..4].eq_ignore_ascii_case(b"nan(");
        if plain.len() >= 6 && plain[..6].eq_ignore_ascii_case(b"1.#inf") {
            let is_negative = field.starts_with(b"-");
            return Some(if is_negative { f64::NEG_INFINITY } else { f64::INFINITY });
        }
        (c_nan || plain.starts_with(b"1.#")).then_some(f64::NAN)
    })
}

/// A field without the quotes around it.
pub(crate) fn unquoted(field: &[u8]) -> &[u8] {
    match field {
        [b'"', inner @ .., b'"'] => inner,
        _ => field,
    }
}

/// Digits after the point that the number in `field` needs: `22.23550` needs 4, `1.5e-3` needs 4,
/// `2e3` needs 0. `field` is one that [`number`] reads.
pub(crate) fn decimals(field: &[u8]) -> u32 {
    let field = unquoted(field);
    let exponent_at = field.iter().position(|b| matches!(b, b'e' | b'E')).unwrap_or(field.len());
    let (mantissa, exponent) = field.split_at(exponent_at);
    // An exponent beyond i32 makes the value zero or infinite: neither needs digits.
    let exponent = match exponent.get(1..) {
        Some(digits) => {
            let digits = digits.strip_prefix(b"+").unwrap_or(digits);
            std::str::from_utf8(digits).ok().and_then(|s| s.parse::<i32>().ok()).unwrap_or(0)
        }
        None => 0,
    };
    let after_point = mantissa.iter().rev().position(|&b| b == b'.').unwrap_or(0);
    let digits = mantissa.iter().rev().filter(|b| b.is_ascii_digit());
    let trailing_zeros = digits.clone().take_while(|&&b| b == b'0').count();
    if trailing_zeros == digits.count() {
        return 0;
    }
    let needed = after_point as i64 - trailing_zeros as i64 - i64::from(exponent);
    needed.clamp(0, i64::from(u32::MAX)) as u32
}

/// Whether the numbers of a line have decimal commas: fields between semicolons, blanks or tabs, of
/// which at least one has the form `1,5` and all others are such or whole numbers.
pub(crate) fn has_decimal_commas(line: &[u8]) -> bool {
    let parts = line.split(|b| *b == b';' || b.is_ascii_whitespace()).filter(|p| !p.is_empty());
    let whole = |p: &[u8]| {
        let p = p.strip_prefix(b"-").or(p.strip_prefix(b"+")).unwrap_or(p);
        !p.is_empty() && p.iter().all(u8::is_ascii_digit)
    };
    let (mut count, mut with_comma) = (0, 0);
    for part in parts {
        count += 1;
        match part.iter().position(|&b| b == b',') {
            Some(at) if whole(&part[..at]) && part[at + 1..].iter().all(u8::is_ascii_digit) => {
                // `1,` is a whole number and a separator.
                if at + 1 == part.len() {
                    return false;
                }
                with_comma += 1;
            }
            Some(_) => return false,
            None if !whole(part) => return false,
            None => {}
        }
    }
    count >= 3 && with_comma > 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn split(line: &str) -> Vec<String> {
        fields(line.as_bytes()).map(|f| String::from_utf8_lossy(f).into_owned()).collect()
    }

    #[test]
    fn blanks_tabs_commas_and_semicolons_separate() {
        for line in ["1 2 3", "1,2,3", " 1 , 2 ,3", "1;2;3;", "1\t2 \t 3", "1, 2;3"] {
            assert_eq!(split(line), ["1", "2", "3"], "{line}");
        }
        assert_eq!(split("1,,3"), ["1", "", "3"]);
        assert_eq!(split("  "), Vec::<String>::new());
    }

    #[test]
    fn digits_needed_are_counted() {
        for (field, want) in [
            ("22.23550", 4),
            ("-0.001", 3),
            ("1.5e-3", 4),
            ("1.5E+3", 0),
            ("150e-2", 1),
            ("100e-2", 0),
            ("7", 0),
            ("7.", 0),
            (".25", 2),
            ("0.000", 0),
            ("0e-9", 0),
            ("+1.25e1", 1),
            ("inf", 0),
            ("1e-99999999999", 0),
            ("\"22.23550\"", 4),
        ] {
            assert_eq!(decimals(field.as_bytes()), want, "{field}");
        }
    }

    #[test]
    fn not_a_number_is_a_number_in_any_spelling() {
        for field in ["nan", "NaN", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
            assert!(number(field.as_bytes()).unwrap().is_nan(), "{field}");
        }
        for field in ["", "x", "1,5", "0x10", "1.2.3", "--1", "\"", "\"\"", "\"1"] {
            assert!(number(field.as_bytes()).is_none(), "{field}");
        }
        assert_eq!(number(b"1.#INF00"), Some(f64::INFINITY));
        assert_eq!(number(b"\"-1.#INF\""), Some(f64::NEG_INFINITY));
        assert_eq!(number(b"+1.5"), Some(1.5));
        assert_eq!(number(b"\"-1.5\""), Some(-1.5));
    }

    #[test]
    fn decimal_commas_differ_from_separators() {
        for line in ["1,5;2,5;3,5", "1;2,5;3", "1,5 2,5 3,5", "-1,5\t2\t3"] {
            assert!(has_decimal_commas(line.as_bytes()), "{line}");
        }
        for line in ["1,2,3", "1, 2, 3", "1.5,2.5,3.5", "1;2;3", "-0.5 , 0.6 , 1,2", "x,y;z"] {
            assert!(!has_decimal_commas(line.as_bytes()), "{line}");
        }
    }

    proptest! {
        #[test]
        fn a_number_with_so_many_digits_is_written_exactly(m in -1_000_000i64..1_000_000, shift in 0u32..9, e in -5i32..5) {
            let text = format!("{m}e{}", -(shift as i32) + e);
            let d = decimals(text.as_bytes());
            let value = number(text.as_bytes()).unwrap();
            let again: f64 = format!("{value:.*}", d as usize).parse().unwrap();
            prop_assert_eq!(again, value);
            if d > 0 {
                let fewer: f64 = format!("{value:.*}", d as usize - 1).parse().unwrap();
                prop_assert_ne!(fewer, value);
            }
        }
    }
}
