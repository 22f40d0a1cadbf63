//! Ranges of values against exact comparisons of whole numbers and floats.

use super::*;
use crate::attribute::{Attribute, names};
use proptest::prelude::*;
use proptest::sample::select;
use std::cmp::Ordering;

const TYPES: [AttrType; 10] = [
    AttrType::U8,
    AttrType::I8,
    AttrType::U16,
    AttrType::I16,
    AttrType::U32,
    AttrType::I32,
    AttrType::U64,
    AttrType::I64,
    AttrType::F32,
    AttrType::F64,
];

fn is_float(ty: AttrType) -> bool {
    matches!(ty, AttrType::F32 | AttrType::F64)
}

fn schema(ty: AttrType, scale: f64, offset: f64) -> Schema {
    Schema::new(vec![Attribute { scale, offset, ..Attribute::new("value", ty) }])
}

fn tests(range: &str, schema: &Schema) -> ValueTests {
    ValueTests::new(&[range.parse().unwrap()], schema)
}

fn keeps(tests: &ValueTests, value: &[u8]) -> bool {
    tests.keep(|_| Some(value))
}

/// Order of a whole number and a float that is a number.
fn order(whole: i128, float: f64) -> Ordering {
    if float.abs() >= 1e38 {
        return 0.0f64.total_cmp(&float);
    }
    let by_whole = whole.cmp(&(float.trunc() as i128));
    by_whole.then_with(|| 0.0f64.partial_cmp(&float.fract()).unwrap())
}

/// Whether a stored value lies within the ends, by the definition.
fn is_within(ty: AttrType, value: &[u8], ends: [Option<Bound>; 2]) -> bool {
    let of_end = |end: Bound| match (ty, end) {
        (AttrType::F32, end) => {
            let end = match end {
                Bound::Whole(number) => number as f64 as f32,
                Bound::Real(number) => number as f32,
            };
            ty.to_f64(value).partial_cmp(&f64::from(end)).unwrap()
        }
        (AttrType::F64, Bound::Whole(number)) => order(number, ty.to_f64(value)).reverse(),
        (AttrType::F64, Bound::Real(number)) => ty.to_f64(value).partial_cmp(&number).unwrap(),
        (_, Bound::Whole(number)) => reference(ty, value).cmp(&number),
        (_, Bound::Real(number)) => order(reference(ty, value), number),
    };
    if is_float(ty) && ty.to_f64(value).is_nan() {
        return false;
    }
    let [low, high] = ends.map(|end| end.map(of_end));
    low != Some(Ordering::Less) && high != Some(Ordering::Greater)
}

fn reference(ty: AttrType, value: &[u8]) -> i128 {
    match ty {
        AttrType::U64 => u64::from_le_bytes(value.try_into().unwrap()).into(),
        AttrType::I64 => i64::from_le_bytes(value.try_into().unwrap()).into(),
        _ => ty.to_f64(value) as i128,
    }
}

/// Bytes of values of `ty`: any bits, or whole numbers near 0 and near the ends of the type.
fn value(ty: AttrType) -> impl Strategy<Value = Vec<u8>> {
    let near = select(vec![-3i64, -1, 0, 1, 2, 300, (1 << 53) + 1, i64::MAX - 1, i64::MIN + 1]);
    prop_oneof![any::<u64>(), near.prop_map(|number| number as u64)].prop_map(
        move |bits| match ty {
            AttrType::F32 if bits & 1 == 0 => ((bits as i64) as f32).to_le_bytes().to_vec(),
            AttrType::F64 if bits & 1 == 0 => ((bits as i64) as f64).to_le_bytes().to_vec(),
            _ => bits.to_le_bytes()[..ty.size()].to_vec(),
        },
    )
}

/// An end at a value, beside it, or anywhere.
fn end(ty: AttrType, value: &[u8], [kind, by]: [i128; 2], real: f64) -> Option<Bound> {
    match kind.rem_euclid(5) {
        0 => None,
        1 => Bound::new(real),
        2 => Some(Bound::Whole(by)),
        3 if is_float(ty) => Bound::new(ty.to_f64(value)),
        4 if is_float(ty) => Bound::new(ty.to_f64(value).next_up()),
        3 => Some(Bound::Whole(reference(ty, value) + by.rem_euclid(3) - 1)),
        _ => Bound::new(ty.to_f64(value) + 0.5),
    }
}

/// A type, values of it, and what makes two ends.
type Case = (AttrType, Vec<Vec<u8>>, [[i128; 2]; 2], [f64; 2]);

fn case() -> impl Strategy<Value = Case> {
    select(TYPES.to_vec()).prop_flat_map(|ty| {
        let values = proptest::collection::vec(value(ty), 1..6);
        (Just(ty), values, any::<[[i128; 2]; 2]>(), any::<[f64; 2]>())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn a_value_is_kept_exactly_within_the_ends((ty, values, kinds, reals) in case()) {
        let ends = [0, 1].map(|i| end(ty, &values[0], kinds[i], reals[i]));
        let range = ValueRange { name: "value".into(), ends };
        let tests = ValueTests::new(std::slice::from_ref(&range), &schema(ty, 1.0, 0.0));
        for value in &values {
            prop_assert_eq!(
                keeps(&tests, value), is_within(ty, value, ends), "{} {:?} {:?}", range, ty, value
            );
        }
        prop_assert!(!tests.keep(|_| None));
        // What is written is the same range, unless its ends are in the wrong order.
        if let Ok(read) = range.to_string().parse::<ValueRange>() {
            prop_assert_eq!(read, range);
        }
    }

    #[test]
    fn least_and_greatest_value_decide_as_all_values_do(
        (ty, values, kinds, reals) in case(), scale in select(vec![1.0, 0.01, -0.5]),
        part in select(vec![Part::Whole, Part::ReturnNumber, Part::ReturnCount]),
    ) {
        let ends = [0, 1].map(|i| end(ty, &values[0], kinds[i], reals[i]));
        let test = ValueTest::new(&schema(ty, scale, 0.0), 0, part, ends);
        let number = |value: &&Vec<u8>| !is_float(ty) || !ty.to_f64(value).is_nan();
        let order = |a: &&Vec<u8>, b: &&Vec<u8>| match is_float(ty) {
            true => ty.to_f64(a).total_cmp(&ty.to_f64(b)),
            false => reference(ty, a).cmp(&reference(ty, b)),
        };
        let least = values.iter().filter(number).min_by(order);
        let greatest = values.iter().filter(number).max_by(order);
        let range = least.zip(greatest).map(|(a, b)| [a.as_slice(), b.as_slice()]);
        let are_all = values.iter().all(|value| number(&value));
        let tests = ValueTests { conditions: vec![vec![test]] };
        let kept = values.iter().filter(|value| keeps(&tests, value)).count();
        match tests.side(|_| NodeValues { range, are_all }) {
            Side::Inside => prop_assert_eq!(kept, values.len()),
            Side::Outside => prop_assert_eq!(kept, 0),
            Side::Across => {}
        }
    }

    /// Steps of 0.01, 0.006 and 0.3 are written as people write them.
    #[test]
    fn an_end_of_scaled_values_is_the_step_that_it_names(
        step in -20_000i16..20_000, scale in select(vec![("0.01", 2, 1), ("0.006", 3, 6), ("0.3", 1, 3)]),
    ) {
        let (text, digits, unit) = scale;
        let schema = schema(AttrType::I16, text.parse().unwrap(), 0.0);
        let number = i64::from(step) * unit;
        let power = 10i64.pow(digits);
        let sign = if number < 0 { "-" } else { "" };
        let (number, digits) = (number.abs(), digits as usize);
        let end = format!("{sign}{}.{:0digits$}", number / power, number % power);
        let only = tests(&format!("value:{end}..{end}"), &schema);
        for other in [step - 1, step, step + 1] {
            prop_assert_eq!(keeps(&only, &other.to_le_bytes()), other == step, "{}", end);
        }
    }
}

#[test]
fn ranges_are_parsed_and_written() {
    for (text, written) in [
        ("intensity:100..4000", "intensity:100..4000"),
        ("a:b: -1.5 .. 2e3", "a:b:-1.5..2000"),
        ("id:18446744073709551615..", "id:18446744073709551615.."),
        ("x:..-0.25", "x:..-0.25"),
        ("x:..", "x:.."),
        ("x:7..7", "x:7..7"),
    ] {
        let range: ValueRange = text.parse().unwrap();
        assert_eq!(range.to_string(), written);
        assert_eq!(written.parse(), Ok(range));
    }
    for (text, word) in [
        ("intensity", "ATTRIBUTE:MIN..MAX"),
        ("intensity:5", "ATTRIBUTE:MIN..MAX"),
        (":1..2", "ATTRIBUTE:MIN..MAX"),
        ("a:1..x", "`x` is no number"),
        ("a:nan..1", "`nan` is no number"),
        ("a:2..1", "holds no value"),
        ("a:2..1.5", "holds no value"),
    ] {
        let error = text.parse::<ValueRange>().unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn whole_numbers_and_floats_are_compared_without_rounding() {
    let odd = (1u64 << 53) + 1;
    let below = tests(&format!("value:..{odd}"), &schema(AttrType::U64, 1.0, 0.0));
    assert!(keeps(&below, &odd.to_le_bytes()) && !keeps(&below, &(odd + 1).to_le_bytes()));
    let float = tests(&format!("value:{odd}.."), &schema(AttrType::F64, 1.0, 0.0));
    assert!(!keeps(&float, &((odd - 1) as f64).to_le_bytes()));
    assert!(keeps(&float, &((odd + 1) as f64).to_le_bytes()));
    let all = tests("value:..", &schema(AttrType::F32, 1.0, 0.0));
    assert!(keeps(&all, &f32::INFINITY.to_le_bytes()) && !keeps(&all, &f32::NAN.to_le_bytes()));
    let tenth = tests("value:0.1..0.1", &schema(AttrType::F32, 1.0, 0.0));
    assert!(
        keeps(&tenth, &0.1f32.to_le_bytes()) && !keeps(&tenth, &0.1f32.next_up().to_le_bytes())
    );
}

#[test]
fn names_have_all_their_types_and_the_parts_of_returns() {
    let attributes = [("a", AttrType::U8), ("a", AttrType::F32), (names::RETURNS, AttrType::U8)];
    let schema = Schema::new(attributes.map(|(name, ty)| Attribute::new(name, ty)).into());
    let either = tests("A:5..", &schema);
    assert_eq!(either.attributes(), [0, 1]);
    assert!(either.keep(|a| (a == 0).then_some(&[7])));
    assert!(either.keep(|a| Some(if a == 0 { &[1][..] } else { &[0, 0, 192, 64] })));
    assert!(!either.keep(|a| (a == 0).then_some(&[4])));
    let (one, of_three) = (tests("return:1..1", &schema), tests("number_of_returns:3..", &schema));
    assert!(keeps(&one, &[0x31]) && !keeps(&one, &[0x32]));
    assert!(keeps(&of_three, &[0x31]) && !keeps(&of_three, &[0x21]));
    let unknown: ValueRange = "b:1..".parse().unwrap();
    let error = unknown.check(&schema).unwrap_err().to_string();
    assert!(error.ends_with("there are a, return_number, number_of_returns"), "{error}");
}
