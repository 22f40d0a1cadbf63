//! Presents a generated scan as the source of a LAS 1.4 file of point format 7, with header and
//! WKT, so that the LAS writer treats it as any other scan.

use esker_scan::SourceInfo;
use esker_scan::write::Origin;

const HEADER_BYTES: u16 = 375;
const POINT_FORMAT: u8 = 7;
const RECORD_BYTES: u16 = 36;
/// GPS times are adjusted standard time; the CRS is WKT.
const GLOBAL_ENCODING: u16 = 1 | 1 << 4;

/// The generated scan as a LAS source.
pub fn origin(info: &SourceInfo) -> Origin {
    let mut origin = Origin::from(info);
    let mut vlrs = Vec::new();
    if let Some(crs) = &info.crs {
        let (user, data) = (b"LASF_Projection", [crs.text.as_bytes(), &[0]].concat());
        let mut head = [0; 54];
        head[2..2 + user.len()].copy_from_slice(user);
        head[18..20].copy_from_slice(&2112u16.to_le_bytes());
        head[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        vlrs = [&head, data.as_slice()].concat();
    }
    let mut header = vec![0; usize::from(HEADER_BYTES)];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(6, &GLOBAL_ENCODING.to_le_bytes());
    put(24, &[1, 4]);
    put(26, b"synthetic");
    put(58, concat!("esker-generate ", env!("CARGO_PKG_VERSION")).as_bytes());
    // Day and year of creation are fixed, so that equal scans give equal files.
    put(90, &1u16.to_le_bytes());
    put(92, &2000u16.to_le_bytes());
    put(94, &HEADER_BYTES.to_le_bytes());
    put(96, &(u32::from(HEADER_BYTES) + vlrs.len() as u32).to_le_bytes());
    put(100, &u32::from(!vlrs.is_empty()).to_le_bytes());
    put(104, &[POINT_FORMAT]);
    put(105, &RECORD_BYTES.to_le_bytes());
    for axis in 0..3 {
        put(131 + 8 * axis, &info.grid.grid.scale[axis].to_le_bytes());
        put(155 + 8 * axis, &info.grid.grid.offset[axis].to_le_bytes());
    }
    origin.verbatim = vec![("las header".into(), header), ("las vlrs".into(), vlrs)];
    origin
}
