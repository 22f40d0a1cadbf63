//! Which column of a text file is which, as the user says: `x=3,y=2,z=4,intensity=5`.

use std::fmt;
use std::str::FromStr;

/// A column of a text file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Column {
    /// By number, from 1.
    Number(usize),
    /// By its name in the file.
    Name(String),
}

/// What the columns of text files hold. Those that are not named keep what the file tells of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns(Vec<(String, Column)>);

impl Columns {
    /// Names of attributes, or `x`, `y` and `z`, with their columns.
    pub fn entries(&self) -> impl Iterator<Item = (&str, &Column)> {
        self.0.iter().map(|(name, column)| (name.as_str(), column))
    }
}

impl FromStr for Columns {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "write it like x=3,y=2,z=4,intensity=5, with numbers from 1 or names of columns";
        let mut entries: Vec<(String, Column)> = Vec::new();
        for entry in text.split(',').filter(|entry| !entry.trim().is_empty()) {
            let (name, column) = match entry.split_once('=') {
                Some((name, column)) => (name.trim(), column.trim()),
                None => return Err(format!("`{}` has no `=`; {form}", entry.trim())),
            };
            if name.is_empty() || column.is_empty() {
                return Err(format!("`{}` lacks a name or a column; {form}", entry.trim()));
            }
            let column = match column.parse() {
                Ok(0) => return Err(format!("columns are numbered from 1; {form}")),
                Ok(number) => Column::Number(number),
                Err(_) => Column::Name(column.to_owned()),
            };
            let name = match super::naming::axis(name) {
                Some(axis) => ["x", "y", "z"][axis].to_owned(),
                None => name.to_owned(),
            };
            if entries.iter().any(|(earlier, _)| *earlier == name) {
                return Err(format!("`{name}` is given twice"));
            }
            if entries.iter().any(|(_, earlier)| *earlier == column) {
                return Err(format!("column {column} is given twice"));
            }
            entries.push((name, column));
        }
        if entries.is_empty() { Err(form.to_owned()) } else { Ok(Self(entries)) }
    }
}

impl fmt::Display for Columns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (name, column)) in self.0.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            write!(f, "{comma}{name}={column}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Name(name) => name.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_given_by_number_or_name() {
        let columns: Columns = " X=3, y = 2,z=Height [m],intensity=5".parse().unwrap();
        assert_eq!(columns.to_string(), "x=3,y=2,z=Height [m],intensity=5");
        assert_eq!(columns.entries().nth(2), Some(("z", &Column::Name("Height [m]".into()))));
        for (text, want) in [
            ("", "write it like"),
            ("x", "`x` has no `=`"),
            ("x=", "lacks a name or a column"),
            ("x=0", "numbered from 1"),
            ("x=1,X=2", "`x` is given twice"),
            ("x=1,y=1", "column 1 is given twice"),
        ] {
            let error = text.parse::<Columns>().unwrap_err();
            assert!(error.contains(want), "{text}: {error}");
        }
    }
}
