//! Kinds of planes: numbers on disk, names, and the spec of a plane in the metadata.

/// Value for "no attribute" in a directory entry.
pub const NO_ATTRIBUTE: u16 = u16::MAX;
/// Number of the kind of planes that belong to an attribute.
pub(crate) const ATTRIBUTE_KIND: u16 = 10;

/// Contents of a plane. [`PlaneKind::number`] has the numbers on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PlaneKind {
    /// Hot: three `u16` of [`esker_points::quant::hot`], the radius code, a zero byte.
    Position,
    /// Bits that hot positions drop, in the layout of [`esker_points::quant::push_residual`].
    Residual,
    /// Hot: red, green, blue, 255; all zero for a point without colour.
    Colour,
    /// Hot: `u16`.
    Intensity,
    /// Hot: two `i16` of [`esker_points::quant::oct_encode`].
    Normal,
    /// Hot: shapes of splats, [`esker_points::tangents`]; only in files that have them.
    Tangents,
    /// [`esker_points::ClipWords`]; only in files with clip lines.
    ClipLines,
    /// Index of each point's class, `u16`; only in files with several classes.
    Class,
    /// The byte of each 16-bit red, green, blue that the colour plane does not hold.
    ColourRemainder,
    /// Hot: positions with the palette index of each point's colour in place of the zero byte; only
    /// in files with a palette.
    Compact,
    /// Exact values of one attribute, given by its index in the schema.
    Attribute(u16),
    /// A kind that this version does not know; skipped.
    Unknown(u16),
}

impl PlaneKind {
    /// Number on disk.
    pub fn number(self) -> u16 {
        match self {
            Self::Position => 1,
            Self::Residual => 2,
            Self::Colour => 3,
            Self::Intensity => 4,
            Self::Normal => 5,
            Self::Tangents => 6,
            Self::ClipLines => 7,
            Self::Class => 8,
            Self::ColourRemainder => 9,
            Self::Attribute(_) => ATTRIBUTE_KIND,
            Self::Compact => 11,
            Self::Unknown(number) => number,
        }
    }

    /// Whether this version writes such planes. Others are skipped.
    pub fn is_written(self) -> bool {
        !matches!(self, Self::Unknown(_))
    }

    /// Whether it has positions: a node is drawn only with one such plane.
    pub fn has_positions(self) -> bool {
        matches!(self, Self::Position | Self::Compact)
    }

    /// Name in messages.
    pub fn name(self) -> String {
        match self {
            Self::Position => "position".into(),
            Self::Residual => "residual".into(),
            Self::Colour => "colour".into(),
            Self::Intensity => "intensity".into(),
            Self::Normal => "normal".into(),
            Self::Tangents => "tangents".into(),
            Self::ClipLines => "clip lines".into(),
            Self::Class => "class".into(),
            Self::ColourRemainder => "colour remainder".into(),
            Self::Compact => "compact".into(),
            Self::Attribute(index) => format!("attribute {index}"),
            Self::Unknown(number) => format!("of unknown kind {number}"),
        }
    }

    /// Attribute that it belongs to, [`NO_ATTRIBUTE`] for most.
    pub fn attribute(self) -> u16 {
        if let Self::Attribute(index) = self { index } else { NO_ATTRIBUTE }
    }

    /// Kind of this number and attribute.
    pub fn from_number(number: u16, attribute: u16) -> Self {
        match number {
            1 => Self::Position,
            2 => Self::Residual,
            3 => Self::Colour,
            4 => Self::Intensity,
            5 => Self::Normal,
            6 => Self::Tangents,
            7 => Self::ClipLines,
            8 => Self::Class,
            9 => Self::ColourRemainder,
            ATTRIBUTE_KIND => Self::Attribute(attribute),
            11 => Self::Compact,
            other => Self::Unknown(other),
        }
    }
}

/// One plane of every page of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneSpec {
    /// Contents.
    pub kind: PlaneKind,
    /// Whether it is always raw, so that its byte range follows from the node's record.
    pub hot: bool,
    /// Bytes of a point's value; 0 for the residual, whose size follows from the node's hot shift.
    pub value_bytes: u32,
}
