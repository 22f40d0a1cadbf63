//! The record of a coordinate reference system in a LAS file: those of the sources, or one of the
//! text that the user or a file beside a source states. COPC has WKT only.

use crate::error::ScanError;
use crate::las::crs::geo_keys;
use crate::las::vlr::Vlr;
use std::path::Path;

/// Number of the record of a coordinate reference system in WKT.
const WKT_RECORD: u16 = 2112;

/// What the sources state, beside their records.
pub struct StatedSystem {
    /// Text of the first system that LAS can hold.
    pub wkt: Option<String>,
    /// Whether a source has any system.
    pub is_any: bool,
}

/// What became of it.
#[derive(Default)]
pub struct PlacedSystem {
    /// Whether the system is WKT, if it is not that of the sources' records.
    pub is_wkt: Option<bool>,
    /// Whether the file must be LAS 1.4.
    pub needs_1_4: bool,
    /// A note for the user.
    pub note: Option<String>,
}

impl StatedSystem {
    /// Adds the record of the system if the VLRs have none.
    pub fn place(self, vlrs: &mut Vec<Vlr>) -> PlacedSystem {
        if vlrs.iter().any(is_of_crs) {
            return PlacedSystem::default();
        }
        if let Some(record) = self.wkt.as_deref().and_then(crs_record) {
            let is_wkt = record.record == WKT_RECORD;
            insert(record, vlrs);
            return PlacedSystem { is_wkt: Some(is_wkt), needs_1_4: is_wkt, note: None };
        }
        let what = "the coordinate reference system is left out: LAS holds WKT and numbers of GeoTIFF keys";
        PlacedSystem { note: self.is_any.then(|| what.into()), ..PlacedSystem::default() }
    }

    /// Keeps the VLR of a system in WKT, or adds it: that of the text `given`, if there is one.
    ///
    /// # Errors
    /// If the sources, or the user, state a system that is not WKT.
    pub fn place_wkt(
        self,
        path: &Path,
        given: Option<&str>,
        vlrs: &mut Vec<Vlr>,
    ) -> Result<PlacedSystem, ScanError> {
        let is_wkt = |v: &Vlr| is_of_crs(v) && v.record == WKT_RECORD;
        let mut is_any = self.is_any || given.is_some();
        if given.is_some() || !vlrs.iter().any(is_wkt) {
            is_any |= vlrs.iter().any(is_of_crs);
            vlrs.retain(|v| !is_of_crs(v));
        }
        let placed = |note| PlacedSystem { is_wkt: Some(true), needs_1_4: true, note };
        if vlrs.iter().any(is_wkt) {
            return Ok(placed(None));
        }
        let text = given.or(self.wkt.as_deref());
        match text.and_then(crs_record).filter(is_wkt) {
            Some(record) => {
                insert(record, vlrs);
                Ok(placed(None))
            }
            None if is_any => {
                let what = "COPC states its coordinate reference system as WKT, and there is none: give it by --crs, as WKT or a file of it, or export as .laz";
                Err(ScanError::unsupported(path, what))
            }
            None => {
                let what = "no coordinate reference system is stated: no scan has one";
                Ok(placed(Some(what.into())))
            }
        }
    }
}

/// Inserts a record behind all other VLRs, before the EVLRs.
fn insert(record: Vlr, vlrs: &mut Vec<Vlr>) {
    let behind = vlrs.iter().position(Vlr::is_extended).unwrap_or(vlrs.len());
    vlrs.insert(behind, record);
}

/// Whether a record is part of a coordinate reference system: WKT or GeoTIFF keys.
pub fn is_of_crs(vlr: &Vlr) -> bool {
    vlr.user == "LASF_Projection"
}

/// The record of a coordinate reference system, if LAS can hold its text.
pub fn crs_record(text: &str) -> Option<Vlr> {
    if let Some(keys) = geo_keys(text) {
        return Some(Vlr::new("LASF_Projection", 34735, "GeoTIFF keys", keys));
    }
    let is_wkt = text.contains('[') && !text.starts_with("GeoTIFF:");
    let is_wkt = is_wkt && text.len() < usize::from(u16::MAX);
    is_wkt.then(|| Vlr::new("LASF_Projection", WKT_RECORD, "WKT", [text.as_bytes(), &[0]].concat()))
}
