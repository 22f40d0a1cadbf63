//! Origin of the normals in the hot plane.

/// Origin of a file's normal plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// There is no normal plane, whatever attributes the points have.
    #[default]
    None,
    /// Exact normals that the points have as attributes.
    Source,
    /// Estimated by the builder; the sign of a normal is arbitrary.
    Estimated,
    /// Estimated by the builder, and oriented towards the scanner.
    Oriented,
}

impl Normals {
    /// Name in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Source => "source",
            Self::Estimated => "estimated",
            Self::Oriented => "oriented",
        }
    }

    /// The origin of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None, Self::Source, Self::Estimated, Self::Oriented]
            .into_iter()
            .find(|n| n.name() == name)
    }

    /// Whether the builder made them.
    pub fn is_estimated(self) -> bool {
        matches!(self, Self::Estimated | Self::Oriented)
    }

    /// Whether normals distinguish front and back.
    pub fn is_oriented(self) -> bool {
        matches!(self, Self::Source | Self::Oriented)
    }
}
