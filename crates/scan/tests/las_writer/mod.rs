//! Writes small LAS and LAZ files for the tests, every field where the LAS specification puts it,
//! and lists the columns that a reader must return for them. Random bytes in, files and
//! expectations out.

use laz::{LasZipCompressor, LazVlr, LazVlrBuilder};
use std::io::{Cursor, Write};

/// Kind of file: point format, minor version, undescribed extra bytes per point.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    pub format: u8,
    pub minor: u8,
    pub extra: u16,
}

/// A point: coordinates, bytes that all other fields are taken from, extra bytes.
#[derive(Clone, Debug)]
pub struct Point {
    pub position: [i32; 3],
    pub fields: [u8; 60],
    pub extra: Vec<u8>,
}

/// User, number and data of a VLR.
pub type Record = (String, u16, Vec<u8>);

#[derive(Debug)]
pub struct File {
    pub variant: Variant,
    pub points: Vec<Point>,
    pub vlrs: Vec<Record>,
}

impl Variant {
    fn has_gps(self) -> bool {
        !matches!(self.format, 0 | 2)
    }
    fn has_rgb(self) -> bool {
        matches!(self.format, 2 | 3 | 5 | 7 | 8 | 10)
    }
    fn has_nir(self) -> bool {
        matches!(self.format, 8 | 10)
    }
    fn has_wave(self) -> bool {
        matches!(self.format, 4 | 5 | 9 | 10)
    }
    fn header_bytes(self) -> u16 {
        [227, 227, 227, 235, 375, 393][usize::from(self.minor)]
    }
}

impl Point {
    pub fn set_colours(&mut self, _variant: Variant, rgb: [u16; 3]) {
        for (i, value) in rgb.into_iter().enumerate() {
            self.fields[19 + 2 * i..][..2].copy_from_slice(&value.to_le_bytes());
        }
    }

    fn record(&self, variant: Variant) -> Vec<u8> {
        let f = &self.fields;
        let mut out: Vec<u8> = self.position.iter().flat_map(|c| c.to_le_bytes()).collect();
        out.extend(&f[0..2]);
        let (direction, edge) = (f[4] & 1, f[4] >> 1 & 1);
        if variant.format < 6 {
            out.push((f[2] & 7) | (f[3] & 7) << 3 | direction << 6 | edge << 7);
            out.push((f[5] & 31) | (f[6] & 7) << 5);
            out.extend([f[7], f[8]]);
            out.extend(&f[9..11]);
        } else {
            out.push((f[2] & 15) | (f[3] & 15) << 4);
            out.push((f[6] & 15) | (f[4] >> 2 & 3) << 4 | direction << 6 | edge << 7);
            out.extend([f[5], f[8], f[7], f[56]]);
            out.extend(&f[9..11]);
        }
        if variant.has_gps() {
            out.extend(&f[11..19]);
        }
        if variant.has_rgb() {
            out.extend(&f[19..25]);
        }
        if variant.has_nir() {
            out.extend(&f[25..27]);
        }
        if variant.has_wave() {
            out.extend(&f[27..56]);
        }
        out.extend(&self.extra);
        out
    }
}

/// Name and raw values of every attribute that these points must have.
pub fn expected_columns(points: &[Point], variant: Variant) -> Vec<(String, Vec<Vec<u8>>)> {
    let mut columns = Vec::new();
    let mut add = |name: &str, value: &dyn Fn(&Point) -> Vec<u8>| {
        columns.push((name.to_owned(), points.iter().map(value).collect()));
    };
    let is_legacy = variant.format < 6;
    let (returns, classes, bits) = if is_legacy { (7, 31, 7) } else { (15, 255, 15) };
    add("intensity", &|p| p.fields[0..2].to_vec());
    add("returns", &|p| vec![(p.fields[2] & returns) | (p.fields[3] & returns) << 4]);
    add("classification", &|p| vec![p.fields[5] & classes]);
    add("flags", &|p| {
        let channel = if is_legacy { 0 } else { p.fields[4] >> 2 & 3 };
        let scan = (p.fields[4] & 1) << 6 | (p.fields[4] >> 1 & 1) << 7;
        vec![(p.fields[6] & bits) | channel << 4 | scan]
    });
    if is_legacy {
        add("scan_angle_rank", &|p| vec![p.fields[7]]);
    } else {
        add("scan_angle", &|p| vec![p.fields[7], p.fields[56]]);
    }
    add("user_data", &|p| vec![p.fields[8]]);
    add("point_source_id", &|p| p.fields[9..11].to_vec());
    if variant.has_gps() {
        add("gps_time", &|p| p.fields[11..19].to_vec());
    }
    if variant.has_rgb() {
        add("red", &|p| p.fields[19..21].to_vec());
        add("green", &|p| p.fields[21..23].to_vec());
        add("blue", &|p| p.fields[23..25].to_vec());
    }
    if variant.has_nir() {
        add("nir", &|p| p.fields[25..27].to_vec());
    }
    if variant.has_wave() {
        add("wave_packet_descriptor_index", &|p| vec![p.fields[27]]);
        add("wave_packet_offset", &|p| p.fields[28..36].to_vec());
        add("wave_packet_size", &|p| p.fields[36..40].to_vec());
        add("wave_return_point_location", &|p| p.fields[40..44].to_vec());
        add("wave_x_t", &|p| p.fields[44..48].to_vec());
        add("wave_y_t", &|p| p.fields[48..52].to_vec());
        add("wave_z_t", &|p| p.fields[52..56].to_vec());
    }
    for i in 0..usize::from(variant.extra) {
        add(&format!("extra_bytes[{i}]"), &|p| vec![p.extra[i]]);
    }
    columns
}

impl File {
    pub fn las(&self) -> Vec<u8> {
        let mut bytes = self.head(&self.vlrs, false);
        bytes.extend(self.records());
        bytes
    }

    /// Compressed in chunks of `chunk_points` points.
    pub fn laz(&self, chunk_points: u32) -> Vec<u8> {
        let vlr = self.laszip().with_fixed_chunk_size(chunk_points).build();
        self.compressed(vlr, &[self.points.len()])
    }

    pub fn laz_of_varying_chunks(&self, chunks: &[usize]) -> Vec<u8> {
        self.compressed(self.laszip().with_variable_chunk_size().build(), chunks)
    }

    /// As left by a writer that could neither seek back nor finish.
    pub fn laz_without_chunk_table(&self, chunk_points: u32) -> Vec<u8> {
        let mut bytes = self.laz(chunk_points);
        let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        let table = u64::from_le_bytes(bytes[start..start + 8].try_into().unwrap()) as usize;
        bytes[start..start + 8].copy_from_slice(&(-1i64).to_le_bytes());
        bytes.truncate(table);
        bytes.extend((-1i64).to_le_bytes());
        bytes
    }

    fn laszip(&self) -> LazVlrBuilder {
        let Variant { format, extra, .. } = self.variant;
        LazVlrBuilder::default().with_point_format(format, extra).unwrap()
    }

    fn compressed(&self, laszip: LazVlr, chunks: &[usize]) -> Vec<u8> {
        let mut data = Vec::new();
        laszip.write_to(&mut data).unwrap();
        let mut vlrs = self.vlrs.clone();
        vlrs.push((LazVlr::USER_ID.into(), LazVlr::RECORD_ID, data));
        let head = self.head(&vlrs, true);
        let mut out = Cursor::new(Vec::new());
        out.write_all(&head).unwrap();
        let is_varying = laszip.uses_variable_size_chunks();
        let mut compressor = LasZipCompressor::new(out, laszip).unwrap();
        let mut rest = &self.points[..];
        for &points in chunks {
            let (chunk, after) = rest.split_at(points);
            chunk.iter().for_each(|p| compressor.compress_one(&p.record(self.variant)).unwrap());
            if is_varying {
                compressor.finish_current_chunk().unwrap();
            }
            rest = after;
        }
        compressor.done().unwrap();
        compressor.into_inner().into_inner()
    }

    fn records(&self) -> Vec<u8> {
        self.points.iter().flat_map(|p| p.record(self.variant)).collect()
    }

    fn head(&self, vlrs: &[Record], is_compressed: bool) -> Vec<u8> {
        let v = self.variant;
        let count = self.points.len() as u64;
        let vlr_bytes: usize = vlrs.iter().map(|(_, _, data)| 54 + data.len()).sum();
        let mut head = vec![0; usize::from(v.header_bytes())];
        let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"LASF");
        put(24, &[1, v.minor]);
        put(94, &v.header_bytes().to_le_bytes());
        put(96, &(u32::from(v.header_bytes()) + vlr_bytes as u32).to_le_bytes());
        put(100, &(vlrs.len() as u32).to_le_bytes());
        put(104, &[v.format | if is_compressed { 0x80 } else { 0 }]);
        let record = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67u16][usize::from(v.format)];
        put(105, &(record + v.extra).to_le_bytes());
        if v.format < 6 {
            put(107, &(count as u32).to_le_bytes());
        }
        for axis in 0..3 {
            put(131 + 8 * axis, &0.01f64.to_le_bytes());
            put(179 + 16 * axis, &(1e6f64).to_le_bytes());
            put(187 + 16 * axis, &(-1e6f64).to_le_bytes());
        }
        if v.minor >= 4 {
            put(247, &count.to_le_bytes());
        }
        for (user, number, data) in vlrs {
            let mut vlr = [0; 54];
            vlr[2..2 + user.len()].copy_from_slice(user.as_bytes());
            vlr[18..20].copy_from_slice(&number.to_le_bytes());
            vlr[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
            head.extend(vlr);
            head.extend(data);
        }
        head
    }
}

/// The VLR that describes extra bytes: data type, options and name of each; scale 0.25, offset -3.
pub fn extra_bytes_vlr(dimensions: &[(u8, u8, &str)]) -> Record {
    let mut data = Vec::new();
    for &(kind, options, name) in dimensions {
        let mut d = [0; 192];
        (d[2], d[3]) = (kind, options);
        d[4..4 + name.len()].copy_from_slice(name.as_bytes());
        d[112..120].copy_from_slice(&0.25f64.to_le_bytes());
        d[136..144].copy_from_slice(&(-3f64).to_le_bytes());
        let description = format!("about {name}");
        d[160..160 + description.len()].copy_from_slice(description.as_bytes());
        data.extend(d);
    }
    ("LASF_Spec".into(), 4, data)
}
