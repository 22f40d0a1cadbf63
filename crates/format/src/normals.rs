//! Where the normals of the hot plane come from.

/// The origin of a file's normal plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// There is no normal plane, whatever attributes the points have.
    #[default]
    None,
    /// The exact normals that the points have as attributes.
    Source,
    /// Estimated by the builder; which of its two directions a normal has means nothing.
    Estimated,
    /// Estimated by the builder, and turned to where the point was scanned from.
    Oriented,
}

impl Normals {
    /// The word for it in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Source => "source",
            Self::Estimated => "estimated",
            Self::Oriented => "oriented",
        }
    }

    /// What a word stands for.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None, Self::Source, Self::Estimated, Self::Oriented]
            .into_iter()
            .find(|n| n.name() == name)
    }

    /// Whether the builder made them.
    pub fn is_estimated(self) -> bool {
        matches!(self, Self::Estimated | Self::Oriented)
    }

    /// Whether a point whose normal looks away shows its back.
    pub fn is_oriented(self) -> bool {
        matches!(self, Self::Source | Self::Oriented)
    }
}
