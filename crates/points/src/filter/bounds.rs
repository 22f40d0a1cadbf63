//! Boxes along the axes of the coordinates, parsed from a text.

use super::condition::FilterError;
use std::str::FromStr;

/// A box in world units; without a third axis it is unbounded upwards and downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least corner.
    pub min: [f64; 3],
    /// Greatest corner.
    pub max: [f64; 3],
}

impl FromStr for Bounds {
    type Err = FilterError;

    /// Parses `x0,y0,z0,x1,y1,z1` or `x0,y0,x1,y1`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let wrong = |what: &str| {
            FilterError(format!("`{text}` is no box: {what}, as x0,y0,z0,x1,y1,z1 or x0,y0,x1,y1"))
        };
        let numbers: Option<Vec<f64>> = text
            .split(',')
            .map(|n| n.trim().parse().ok().filter(|v: &f64| v.is_finite()))
            .collect();
        let (min, max) = match numbers.as_deref() {
            Some(&[x0, y0, z0, x1, y1, z1]) => ([x0, y0, z0], [x1, y1, z1]),
            Some(&[x0, y0, x1, y1]) => ([x0, y0, f64::NEG_INFINITY], [x1, y1, f64::INFINITY]),
            _ => return Err(wrong("it needs six or four numbers")),
        };
        if (0..3).any(|i| min[i] > max[i]) {
            return Err(wrong("the least corner comes first"));
        }
        Ok(Self { min, max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_parsed() {
        let bounds: Bounds = "-1,2, 3,4,5,6".parse().unwrap();
        assert_eq!((bounds.min, bounds.max), ([-1.0, 2.0, 3.0], [4.0, 5.0, 6.0]));
        let flat: Bounds = "0,0,1,1".parse().unwrap();
        assert_eq!((flat.min[2], flat.max[2]), (f64::NEG_INFINITY, f64::INFINITY));
        for (text, word) in [
            ("1,2,3", "six or four"),
            ("a,b,c,d", "six or four"),
            ("1,2,nan,4", "six"),
            ("2,0,1,1", "least corner"),
        ] {
            let error = text.parse::<Bounds>().unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
