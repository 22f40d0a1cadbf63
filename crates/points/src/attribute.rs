//! Attributes of points: names, types, and Esker's names for LAS fields. Bits that LAS packs stay
//! packed, in the layout of LAS 1.4 formats 6 to 10, whatever the source: `returns` (number of this
//! return in bits 0-3, number of returns in 4-7) and `flags` (synthetic 0, key point 1, withheld 2,
//! overlap 3, scanner channel 4-5, scan direction 6, edge of flight line 7).

use serde::{Deserialize, Serialize};

/// Type of an attribute's values; all are stored little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttrType {
    /// Unsigned 8-bit integer.
    U8,
    /// Signed 8-bit integer.
    I8,
    /// Unsigned 16-bit integer.
    U16,
    /// Signed 16-bit integer.
    I16,
    /// Unsigned 32-bit integer.
    U32,
    /// Signed 32-bit integer.
    I32,
    /// Unsigned 64-bit integer.
    U64,
    /// Signed 64-bit integer.
    I64,
    /// IEEE 754 single.
    F32,
    /// IEEE 754 double.
    F64,
}

impl AttrType {
    /// The narrowest type that holds all values of both types exactly, if there is one.
    pub fn wider(self, other: Self) -> Option<Self> {
        // Bits of whole numbers, of negative ones too, that a type holds exactly.
        let holds = |ty: Self, of: Self| -> bool {
            let (own, own_signed) = ty.whole_bits();
            let (bits, signed) = of.whole_bits();
            let is_float = |ty| matches!(ty, Self::F32 | Self::F64);
            own >= bits && (own_signed || !signed) && (is_float(ty) || !is_float(of))
        };
        use AttrType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        let all = [U8, I8, U16, I16, U32, I32, F32, U64, I64, F64];
        all.into_iter().find(|&ty| holds(ty, self) && holds(ty, other))
    }

    /// Bits of the greatest whole number below which all are exact, and whether there are negative
    /// ones.
    fn whole_bits(self) -> (u32, bool) {
        match self {
            Self::U8 => (8, false),
            Self::I8 => (7, true),
            Self::U16 => (16, false),
            Self::I16 => (15, true),
            Self::F32 => (24, true),
            Self::U32 => (32, false),
            Self::I32 => (31, true),
            Self::F64 => (53, true),
            Self::U64 => (64, false),
            Self::I64 => (63, true),
        }
    }

    /// Bytes of one value.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Name in files and messages: `u8`, `i16`, `f64` ...
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// The value as `f64`, for statistics and colour maps (64-bit integers round).
    ///
    /// # Panics
    /// If `bytes` is shorter than [`AttrType::size`].
    pub fn to_f64(self, bytes: &[u8]) -> f64 {
        macro_rules! le {
            ($t:ty) => {{
                let mut raw = [0u8; size_of::<$t>()];
                raw.copy_from_slice(&bytes[..size_of::<$t>()]);
                <$t>::from_le_bytes(raw) as f64
            }};
        }
        match self {
            Self::U8 => f64::from(bytes[0]),
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U16 => le!(u16),
            Self::I16 => le!(i16),
            Self::U32 => le!(u32),
            Self::I32 => le!(i32),
            Self::U64 => le!(u64),
            Self::I64 => le!(i64),
            Self::F32 => le!(f32),
            Self::F64 => le!(f64),
        }
    }
}

/// One attribute of a schema.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attribute {
    /// Name; unique in a schema together with the type.
    pub name: String,
    /// Type of the stored value.
    #[serde(rename = "type")]
    pub ty: AttrType,
    /// Description in the source; empty if there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Displayed values are stored values times `scale` plus `offset` (extra bytes of LAS).
    /// Otherwise 1 and 0.
    #[serde(default = "one")]
    pub scale: f64,
    /// See `scale`.
    #[serde(default)]
    pub offset: f64,
}

fn one() -> f64 {
    1.0
}

impl Attribute {
    /// An attribute without description, scale or offset.
    pub fn new(name: impl Into<String>, ty: AttrType) -> Self {
        Self { name: name.into(), ty, description: String::new(), scale: 1.0, offset: 0.0 }
    }

    /// Identity of an attribute: name and type.
    pub fn key(&self) -> (&str, AttrType) {
        (&self.name, self.ty)
    }
}

/// Name of the block of a source, without bytes, which states that its points cover a closed
/// surface with normals that look outwards: what faces away is hidden.
pub const CLOSED_BLOCK: &str = "closed surface";

/// Esker's names for LAS fields and for similar fields of other formats.
pub mod names {
    /// Pulse return magnitude, `u16`.
    pub const INTENSITY: &str = "intensity";
    /// Return number (bits 0-3) and number of returns (bits 4-7), `u8`.
    pub const RETURNS: &str = "returns";
    /// Classification flags, scanner channel, scan direction, edge of flight line, `u8`.
    pub const FLAGS: &str = "flags";
    /// ASPRS class, `u8`.
    pub const CLASSIFICATION: &str = "classification";
    /// User data, `u8`.
    pub const USER_DATA: &str = "user_data";
    /// Scan angle of formats 0-5, whole degrees, `i8`.
    pub const SCAN_ANGLE_RANK: &str = "scan_angle_rank";
    /// Scan angle of formats 6-10, steps of 0.006 degrees, `i16`.
    pub const SCAN_ANGLE: &str = "scan_angle";
    /// Point source id, `u16`.
    pub const POINT_SOURCE_ID: &str = "point_source_id";
    /// GPS time, seconds in the meaning of the source's global encoding, `f64`.
    pub const GPS_TIME: &str = "gps_time";
    /// Red, `u16` in LAS, `u8` in most PLY.
    pub const RED: &str = "red";
    /// Green, `u16` in LAS, `u8` in most PLY.
    pub const GREEN: &str = "green";
    /// Blue, `u16` in LAS, `u8` in most PLY.
    pub const BLUE: &str = "blue";
    /// Near infrared, `u16`.
    pub const NIR: &str = "nir";
    /// Waveform: descriptor index, `u8`.
    pub const WAVE_DESCRIPTOR: &str = "wave_packet_descriptor_index";
    /// Waveform: byte offset to the packet, `u64` (packets themselves are not kept).
    pub const WAVE_OFFSET: &str = "wave_packet_offset";
    /// Waveform: packet size in bytes, `u32`.
    pub const WAVE_SIZE: &str = "wave_packet_size";
    /// Waveform: location of the return point, `f32`.
    pub const WAVE_RETURN_POINT: &str = "wave_return_point_location";
    /// Waveform: parametric dx, `f32`.
    pub const WAVE_X_T: &str = "wave_x_t";
    /// Waveform: parametric dy, `f32`.
    pub const WAVE_Y_T: &str = "wave_y_t";
    /// Waveform: parametric dz, `f32`.
    pub const WAVE_Z_T: &str = "wave_z_t";
    /// Unit normal, x, `f32`.
    pub const NX: &str = "nx";
    /// Unit normal, y, `f32`.
    pub const NY: &str = "ny";
    /// Unit normal, z, `f32`.
    pub const NZ: &str = "nz";
    /// Clip lines of a splat ([`crate::clip`]), `u8`: 0 none, 1 one, 2 two (intersection of what
    /// they keep), 3 two (union of what they keep).
    pub const CLIP: &str = "clip";
    /// Ends of the clip lines, in the file's coordinates, `f64`: two points of the first line, two
    /// of the second. The part to the left of the direction from the first to the second point is
    /// kept, seen from the side that the normal points to. Lines that two splats share have the
    /// same points, in either order, about as far apart as the splats are away.
    pub const CLIP_ENDS: [[&str; 3]; 4] = [
        ["clip_x1", "clip_y1", "clip_z1"],
        ["clip_x2", "clip_y2", "clip_z2"],
        ["clip_x3", "clip_y3", "clip_z3"],
        ["clip_x4", "clip_y4", "clip_z4"],
    ];
}
