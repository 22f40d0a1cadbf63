//! Strict reading of the metadata's JSON: objects are objects, words are strings, every member is
//! there, and nesting is bounded. serde by itself also takes an array for a structure, an object
//! for a word, and a missing member for null; other readers of the format do not.

use crate::error::Fault;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, Error, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// Greatest depth of arrays and objects; what is specified needs six.
pub(crate) const DEPTH_MAX: usize = 100;

/// Reads a value from its JSON text.
///
/// # Errors
/// If the text is no UTF-8, nests too deep, or is not an object of that kind.
pub(crate) fn from_json<T: DeserializeOwned>(json: &[u8]) -> Result<T, Fault> {
    let fault = |what: String| Fault::new("metadata", what);
    let text = str::from_utf8(json).map_err(|e| fault(e.to_string()))?;
    check_depth(json)?;
    let object: Object<T> = serde_json::from_str(text).map_err(|e| fault(e.to_string()))?;
    Ok(object.0)
}

/// Bounds the nesting of arrays and objects: also of members that are ignored.
fn check_depth(json: &[u8]) -> Result<(), Fault> {
    let (mut depth, mut in_string, mut escaped) = (0usize, false, false);
    for &byte in json {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            b'[' | b'{' if !in_string => depth += 1,
            b']' | b'}' if !in_string => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > DEPTH_MAX {
            let what = format!("its arrays and objects are nested deeper than {DEPTH_MAX} levels");
            return Err(Fault::new("metadata", what));
        }
    }
    Ok(())
}

/// A structure that is an object in JSON.
struct Object<T>(T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Members<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Members<T> {
            type Value = T;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map))
            }
        }
        d.deserialize_map(Members(PhantomData)).map(Self)
    }
}

/// Reads an object.
pub(crate) fn object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(d: D) -> Result<T, D::Error> {
    Object::deserialize(d).map(|object| object.0)
}

/// Reads an array of objects.
pub(crate) fn objects<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    d: D,
) -> Result<Vec<T>, D::Error> {
    let objects = Vec::<Object<T>>::deserialize(d)?;
    Ok(objects.into_iter().map(|object| object.0).collect())
}

/// Reads an object or null; the member must be there.
pub(crate) fn nullable_object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    d: D,
) -> Result<Option<T>, D::Error> {
    Ok(Option::<Object<T>>::deserialize(d)?.map(|object| object.0))
}

/// Reads a value or null; the member must be there.
pub(crate) fn nullable<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    d: D,
) -> Result<Option<T>, D::Error> {
    Option::deserialize(d)
}

/// Reads one of several words.
pub(crate) fn word<'de, D: Deserializer<'de>, T: Deserialize<'de>>(d: D) -> Result<T, D::Error> {
    T::deserialize(String::deserialize(d)?.into_deserializer())
}

/// Reads one of several words, or null; the member must be there.
pub(crate) fn nullable_word<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    d: D,
) -> Result<Option<T>, D::Error> {
    let word = Option::<String>::deserialize(d)?;
    word.map(|word| T::deserialize(word.into_deserializer())).transpose()
}

/// A number that may be infinite or NaN, which is then a string: JSON has no such numbers.
#[derive(Clone, Copy)]
pub(crate) struct Real(pub f64);

impl Serialize for Real {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        if self.0.is_finite() { s.serialize_f64(self.0) } else { s.collect_str(&self.0) }
    }
}

impl<'de> Deserialize<'de> for Real {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Either {
            Number(f64),
            Text(String),
        }
        let text = match Either::deserialize(d)? {
            Either::Number(v) => return Ok(Self(v)),
            Either::Text(text) => text,
        };
        match text.as_str() {
            "NaN" => Ok(Self(f64::NAN)),
            "inf" => Ok(Self(f64::INFINITY)),
            "-inf" => Ok(Self(f64::NEG_INFINITY)),
            _ => Err(D::Error::custom("a string that is not NaN, inf or -inf")),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use esker_points::AttrType;

    #[derive(Deserialize, Debug)]
    struct Strict {
        #[serde(rename = "type", deserialize_with = "word")]
        ty: AttrType,
        #[serde(deserialize_with = "nullable")]
        index: Option<u16>,
    }

    #[test]
    fn only_what_is_specified_is_read() {
        let read = |text: &str| from_json::<Strict>(text.as_bytes());
        let good = read(r#"{"type": "u8", "index": null, "more": [{"a": "]]]\"[["}]}"#).unwrap();
        assert_eq!((good.ty, good.index), (AttrType::U8, None));
        for bad in [
            r#"["u8", null]"#,
            r#"{"type": {"u8": null}, "index": null}"#,
            r#"{"type": "u8"}"#,
            r#"{"type": "u8", "index": 1.0}"#,
            r#"{"type": "u8", "index": -0}"#,
            r#"{"type": "u8", "index": 65536}"#,
        ] {
            read(bad).unwrap_err();
        }
        from_json::<Strict>(b"{\"type\": \"u8\", \"index\": null, \"more\": \"\xff\"}")
            .unwrap_err();
    }

    #[test]
    fn nesting_is_bounded_also_where_it_is_ignored() {
        let nested = |depth: usize| {
            let (open, close) = ("[".repeat(depth - 1), "]".repeat(depth - 1));
            from_json::<Strict>(
                format!(r#"{{"type": "u8", "index": 3, "more": {open}{close}}}"#).as_bytes(),
            )
        };
        assert_eq!(nested(DEPTH_MAX).unwrap().index, Some(3));
        assert!(nested(DEPTH_MAX + 1).unwrap_err().fault.contains("nested deeper"));
        nested(1_000_000).unwrap_err();
    }
}
