//! The point item of layered chunks, point formats 6 to 10 (LASzip `lasreaditemcompressed_v3.cpp`,
//! POINT14): each field is a layer of bytes with a decoder of its own, and each of four scanner
//! channels has its own state.

use super::gps_time::GpsTimes;
use super::median::Median;
use laz::DecompressionSelection;
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::LayeredFieldDecompressor;
use std::io::{self, Cursor, Read};

/// Size of the item, in bytes.
const BYTES: usize = 30;
const CHANNELS: usize = 4;

/// Layers in the order of the file.
const LAYERS: usize = 9;
const PLACE: usize = 0;
const HEIGHT: usize = 1;
const CLASS: usize = 2;
const FLAGS: usize = 3;
const INTENSITY: usize = 4;
const ANGLE: usize = 5;
const USER: usize = 6;
const SOURCE: usize = 7;
const TIME: usize = 8;

/// Context by number of returns and number of the return, both 0 to 15 (LASzip
/// `laszip_common_v3.hpp`, `number_return_map_6ctx`).
const RETURN_CONTEXTS: [&[u8; 16]; 16] = [
    b"0123453445555555",
    b"1013333333333333",
    b"2124444444433333",
    b"3345444444444444",
    b"4344544444444444",
    b"5344454444444444",
    b"3344445444444444",
    b"4344444544444444",
    b"4344444454444444",
    b"5344444445444444",
    b"5344444444544444",
    b"5334444444455444",
    b"5334444444455544",
    b"5334444444445554",
    b"5334444444444555",
    b"5334444444444455",
];

/// Decoder of one layer; `None` if it is empty: the field stays as it is.
type Layer = Option<ArithmeticDecoder<Cursor<Vec<u8>>>>;

/// Models that are made when they are first used.
struct Models {
    symbols: u32,
    models: Vec<Option<ArithmeticModel>>,
}

impl Models {
    fn new(number: usize, symbols: u32) -> Self {
        Self { symbols, models: std::iter::repeat_with(|| None).take(number).collect() }
    }

    fn get(&mut self, place: usize) -> &mut ArithmeticModel {
        let symbols = self.symbols;
        self.models[place].get_or_insert_with(|| ArithmeticModelBuilder::new(symbols).build())
    }
}

fn integers(bits: u32, contexts: u32) -> IntegerDecompressor {
    IntegerDecompressorBuilder::new().bits(bits).contexts(contexts).build_initialized()
}

/// The fields of a record.
#[derive(Clone, Copy)]
struct Record {
    position: [i32; 3],
    intensity: u16,
    /// Number of the return in the low 4 bits, number of returns in the high ones.
    returns: u8,
    /// Classification flags in the low 4 bits, then scanner channel, direction and edge.
    flags: u8,
    class: u8,
    user: u8,
    angle: i16,
    source: u16,
    time: i64,
}

impl Record {
    fn read(bytes: &[u8; BYTES]) -> Self {
        let i32_at = |i: usize| i32::from_le_bytes(std::array::from_fn(|k| bytes[i + k]));
        let u16_at = |i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
        Self {
            position: [i32_at(0), i32_at(4), i32_at(8)],
            intensity: u16_at(12),
            returns: bytes[14],
            flags: bytes[15],
            class: bytes[16],
            user: bytes[17],
            angle: u16_at(18).cast_signed(),
            source: u16_at(20),
            time: i64::from_le_bytes(std::array::from_fn(|k| bytes[22 + k])),
        }
    }

    fn write(&self, bytes: &mut [u8; BYTES]) {
        for (axis, bytes) in self.position.iter().zip(bytes.chunks_exact_mut(4)) {
            bytes.copy_from_slice(&axis.to_le_bytes());
        }
        bytes[12..14].copy_from_slice(&self.intensity.to_le_bytes());
        bytes[14..18].copy_from_slice(&[self.returns, self.flags, self.class, self.user]);
        bytes[18..20].copy_from_slice(&self.angle.to_le_bytes());
        bytes[20..22].copy_from_slice(&self.source.to_le_bytes());
        bytes[22..].copy_from_slice(&self.time.to_le_bytes());
    }

    fn channel(&self) -> usize {
        usize::from(self.flags >> 4 & 3)
    }

    fn set_channel(&mut self, channel: usize) {
        self.flags = self.flags & !0x30 | (channel as u8) << 4;
    }

    /// Number of the return, and number of returns.
    fn returns(&self) -> [u32; 2] {
        [u32::from(self.returns & 15), u32::from(self.returns >> 4)]
    }
}

/// State of a scanner channel.
struct Channel {
    last: Record,
    last_changed_time: bool,
    changes: Models,
    channel: ArithmeticModel,
    number_of_returns: Models,
    returns: Models,
    return_at_same_time: ArithmeticModel,
    x: IntegerDecompressor,
    y: IntegerDecompressor,
    z: IntegerDecompressor,
    x_steps: [Median; 12],
    y_steps: [Median; 12],
    heights: [i32; 8],
    classes: Models,
    flags: Models,
    intensity: IntegerDecompressor,
    intensities: [u16; 8],
    angle: IntegerDecompressor,
    users: Models,
    source: IntegerDecompressor,
    times: GpsTimes,
}

impl Channel {
    fn new(last: Record) -> Self {
        Self {
            last,
            last_changed_time: false,
            changes: Models::new(8, 128),
            channel: ArithmeticModelBuilder::new(3).build(),
            number_of_returns: Models::new(16, 16),
            returns: Models::new(16, 16),
            return_at_same_time: ArithmeticModelBuilder::new(13).build(),
            x: integers(32, 2),
            y: integers(32, 22),
            z: integers(32, 20),
            x_steps: Default::default(),
            y_steps: Default::default(),
            heights: [last.position[2]; 8],
            classes: Models::new(64, 256),
            flags: Models::new(64, 64),
            intensity: integers(16, 4),
            intensities: [last.intensity; 8],
            angle: integers(16, 2),
            users: Models::new(64, 256),
            source: integers(16, 1),
            times: GpsTimes::new(last.time, false),
        }
    }

    /// Which fields change, as bits: 0 and 1 how the number of the return does, 2 the number of
    /// returns, 3 the scan angle, 4 the time, 5 the source, 6 the channel.
    fn changes<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<u32> {
        let [number, of] = self.last.returns();
        let context = usize::from(number == 1)
            | usize::from(number >= of) << 1
            | usize::from(self.last_changed_time) << 2;
        decoder.decode_symbol(self.changes.get(context))
    }

    /// Decodes the next record; `changes` are known already.
    fn next(&mut self, changes: u32, layers: &mut [Layer; LAYERS]) -> io::Result<&Record> {
        let time_changes = changes >> 4 & 1 != 0;
        let place = layers[PLACE].as_mut().ok_or(io::ErrorKind::UnexpectedEof)?;
        let [number, of] = self.next_returns(changes, place)?;
        let is_single = u32::from(of == 1);
        let table = RETURN_CONTEXTS[of as usize][number as usize] - b'0';
        let steps = usize::from(table) << 1 | usize::from(time_changes);
        let kind = u32::from(number == 1) << 1 | u32::from(number >= of);
        let even = |k: u32, max: u32| k.min(max) & !1;

        let [x, y, z] = &mut self.last.position;
        let step = self.x.decompress(place, self.x_steps[steps].get(), is_single)?;
        self.x_steps[steps].add(step);
        *x = x.wrapping_add(step);
        let context = is_single + even(self.x.k(), 20);
        let step = self.y.decompress(place, self.y_steps[steps].get(), context)?;
        self.y_steps[steps].add(step);
        *y = y.wrapping_add(step);
        if let Some(layer) = &mut layers[HEIGHT] {
            let context = is_single + even((self.x.k() + self.y.k()) / 2, 18);
            let level = number.abs_diff(of).min(7) as usize;
            *z = self.z.decompress(layer, self.heights[level], context)?;
            self.heights[level] = *z;
        }

        let last = &mut self.last;
        if let Some(layer) = &mut layers[CLASS] {
            let context = usize::from(last.class & 31) << 1 | usize::from(kind == 3);
            last.class = layer.decode_symbol(self.classes.get(context))? as u8;
        }
        if let Some(layer) = &mut layers[FLAGS] {
            // The codes leave out the scanner channel.
            let context = usize::from(last.flags >> 6 << 4 | last.flags & 15);
            let code = layer.decode_symbol(self.flags.get(context))? as u8;
            last.flags = code >> 4 << 6 | last.flags & 0x30 | code & 15;
        }
        if let Some(layer) = &mut layers[INTENSITY] {
            let like = &mut self.intensities[(kind << 1 | u32::from(time_changes)) as usize];
            *like = self.intensity.decompress(layer, i32::from(*like), kind)? as u16;
            last.intensity = *like;
        }
        if let Some(layer) = layers[ANGLE].as_mut().filter(|_| changes >> 3 & 1 != 0) {
            let predicted = i32::from(last.angle);
            last.angle = self.angle.decompress(layer, predicted, time_changes.into())? as i16;
        }
        if let Some(layer) = &mut layers[USER] {
            let context = usize::from(last.user / 4);
            last.user = layer.decode_symbol(self.users.get(context))? as u8;
        }
        if let Some(layer) = layers[SOURCE].as_mut().filter(|_| changes >> 5 & 1 != 0) {
            last.source = self.source.decompress(layer, i32::from(last.source), 0)? as u16;
        }
        if let Some(layer) = layers[TIME].as_mut().filter(|_| time_changes) {
            last.time = self.times.next(layer)?;
        }
        self.last_changed_time = time_changes;
        Ok(&self.last)
    }

    /// Decodes the number of the return and the number of returns.
    fn next_returns<R: Read>(
        &mut self,
        changes: u32,
        decoder: &mut ArithmeticDecoder<R>,
    ) -> io::Result<[u32; 2]> {
        let [last_number, last_of] = self.last.returns();
        let of = match changes >> 2 & 1 {
            0 => last_of,
            _ => decoder.decode_symbol(self.number_of_returns.get(last_of as usize))?,
        };
        let number = match (changes & 3, changes >> 4 & 1) {
            (0, _) => last_number,
            (1, _) => last_number + 1,
            (2, _) => last_number + 15,
            (_, 1) => decoder.decode_symbol(self.returns.get(last_number as usize))?,
            _ => last_number + decoder.decode_symbol(&mut self.return_at_same_time)? + 2,
        };
        let number = number % 16;
        self.last.returns = (number | of << 4) as u8;
        Ok([number, of])
    }
}

/// Decoder of the item in one chunk.
pub struct Point14 {
    version: u16,
    sizes: [u32; LAYERS],
    layers: [Layer; LAYERS],
    channels: [Option<Box<Channel>>; CHANNELS],
    channel: usize,
}

impl Point14 {
    /// Decoder of version 3 or 4 of the item. They differ in when later items of the record learn
    /// of the channel: at every record (4), or only where it changes (3).
    pub fn new(version: u16) -> Self {
        Self {
            version,
            sizes: [0; LAYERS],
            layers: Default::default(),
            channels: Default::default(),
            channel: 0,
        }
    }
}

impl<R: Read> LayeredFieldDecompressor<R> for Point14 {
    fn size_of_field(&self) -> usize {
        BYTES
    }

    /// All fields are decoded.
    fn set_selection(&mut self, _: DecompressionSelection) {}

    fn init_first_point(
        &mut self,
        src: &mut R,
        first_point: &mut [u8],
        context: &mut usize,
    ) -> io::Result<()> {
        let mut bytes = [0; BYTES];
        src.read_exact(&mut bytes)?;
        first_point.copy_from_slice(&bytes);
        let first = Record::read(&bytes);
        self.channel = first.channel();
        *context = self.channel;
        self.channels = Default::default();
        self.channels[self.channel] = Some(Box::new(Channel::new(first)));
        Ok(())
    }

    fn decompress_field_with(
        &mut self,
        current_point: &mut [u8],
        context: &mut usize,
    ) -> io::Result<()> {
        let place = self.layers[PLACE].as_mut().ok_or(io::ErrorKind::UnexpectedEof)?;
        let before = self.channels[self.channel].as_deref_mut();
        let mut channel = before.ok_or_else(|| io::Error::other("no first point"))?;
        let changes = channel.changes(place)?;
        let channel_changes = changes >> 6 & 1 != 0;
        if channel_changes {
            let step = place.decode_symbol(&mut channel.channel)? as usize + 1;
            let last = channel.last;
            self.channel = (self.channel + step) % CHANNELS;
            let next = &mut self.channels[self.channel];
            channel = next.get_or_insert_with(|| Box::new(Channel::new(last)));
            channel.last.set_channel(self.channel);
        }
        if channel_changes || self.version != 3 {
            *context = self.channel;
        }
        let record = channel.next(changes, &mut self.layers)?;
        match current_point.try_into() {
            Ok(bytes) => record.write(bytes),
            Err(_) => return Err(io::Error::other("a record of another size")),
        }
        Ok(())
    }

    fn read_layers_sizes(&mut self, src: &mut R) -> io::Result<()> {
        for size in &mut self.sizes {
            let mut bytes = [0; 4];
            src.read_exact(&mut bytes)?;
            *size = u32::from_le_bytes(bytes);
        }
        Ok(())
    }

    fn read_layers(&mut self, src: &mut R) -> io::Result<()> {
        for (layer, &size) in self.layers.iter_mut().zip(&self.sizes) {
            *layer = None;
            if size > 0 {
                let mut bytes = Vec::new();
                src.by_ref().take(size.into()).read_to_end(&mut bytes)?;
                if bytes.len() < size as usize {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                let mut decoder = ArithmeticDecoder::new(Cursor::new(bytes));
                decoder.read_init_bytes()?;
                *layer = Some(decoder);
            }
        }
        Ok(())
    }
}
