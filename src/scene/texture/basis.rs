//! KTX2 files whose texels Basis Universal has compressed (ETC1S or UASTC), as glTF's KHR_texture_basisu has
//! them.
//!
//! The container (KTX File Format Specification 2.0, 3 "Structure") is checked here: the decoder believes places
//! and lengths, and takes as much memory as they ask for.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::Image;
use super::decode::room;

/// How each KTX2 file begins.
const MAGIC: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// Where the header tells the place and the length of what its writer noted about the file.
const NOTES: std::ops::Range<usize> = 56..64;

/// Colour models and channels of the Khronos Data Format Specification 1.3 (5.6 and 5.16).
const ETC1S: u8 = 163;
const UASTC: u8 = 166;
/// A second sample of ETC1S that is green, beside a first one that is red.
const ETC1S_GREEN: u8 = 4;
/// UASTC with red as its colours and green as its coverage.
const UASTC_RED_GREEN: u8 = 5;

/// Supercompression by Zstandard.
const ZSTANDARD: u32 = 2;

/// Bytes of a block of UASTC, which is 4x4 texels.
const UASTC_BLOCK: u64 = 16;

/// What is used of a file's header. Places are within the file.
struct Header {
    format: u32,
    size: [u32; 2],
    /// More than one picture: slices, layers, faces.
    several: bool,
    levels: u32,
    supercompression: u32,
    /// Colour model.
    model: u8,
    /// Channels of the first two samples.
    channels: [Option<u8>; 2],
}

impl Header {
    /// Reads it; nothing where something lies beyond the file's end.
    fn read(bytes: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        let inside =
            |at: u64, length: u64| at.checked_add(length).is_some_and(|end| end <= bytes.len() as u64);
        let levels = word(40)?.max(1);
        for level in 0..levels {
            let [at, length, _] = Self::level(bytes, level)?;
            inside(at, length).then_some(())?;
        }
        let [global, length] = [Self::long(bytes, 64)?, Self::long(bytes, 72)?];
        inside(global, length).then_some(())?;
        let [place, length] = [word(48)? as usize, word(52)? as usize];
        let described = bytes.get(place..place.checked_add(length)?)?;
        let channel = |sample: usize| described.get(28 + sample * 16 + 3).map(|byte| byte & 15);
        Some(Header {
            format: word(12)?,
            size: [word(20)?, word(24)?],
            several: word(28)? > 0 || word(32)? > 1 || word(36)? != 1,
            levels,
            supercompression: word(44)?,
            model: *described.get(12)?,
            channels: [channel(0), channel(1)],
        })
    }

    fn long(bytes: &[u8], at: usize) -> Option<u64> {
        Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
    }

    /// A level's place, its length, and its length before supercompression.
    fn level(bytes: &[u8], level: u32) -> Option<[u64; 3]> {
        let at = 80 + level as usize * 24;
        Some([Self::long(bytes, at)?, Self::long(bytes, at + 8)?, Self::long(bytes, at + 16)?])
    }

    /// Refuses what is no picture, or compressed in other ways.
    fn check(&self) -> Result<(), String> {
        if self.format != 0 || ![ETC1S, UASTC].contains(&self.model) {
            return Err(
                "it is a KTX2 file, of which ETC1S and UASTC are read; compress it by Basis Universal".into(),
            );
        }
        if self.several {
            return Err("it is a KTX2 file of several pictures, but single ones are read".into());
        }
        let most = 32 - self.size[0].max(self.size[1]).leading_zeros();
        if self.levels > most {
            return Err(format!("it has {} levels, but its size allows {most}", self.levels));
        }
        Ok(())
    }

    /// Whether red and green are kept as colour and coverage.
    fn is_red_green(&self) -> bool {
        match self.model {
            ETC1S => self.channels[1] == Some(ETC1S_GREEN),
            _ => self.channels[0] == Some(UASTC_RED_GREEN),
        }
    }
}

/// Whether a file is one of these.
pub fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Width and height of level 0, from the header alone; what is wrong with the file otherwise.
pub fn size_of(bytes: &[u8]) -> Result<(u32, u32), String> {
    let header = Header::read(bytes).ok_or(CUT)?;
    Ok((header.size[0], header.size[1]))
}

const CUT: &str = "it ends before what its header promises; copy or compress it again";

/// Decodes the level that is so many times halved, or the smallest one if the file has fewer; tells which that is.
///
/// The size has to be accepted beforehand.
pub fn decode(bytes: &[u8], halvings: u32) -> Result<(Image, u32), String> {
    let header = Header::read(bytes).ok_or(CUT)?;
    header.check()?;
    let level = halvings.min(header.levels - 1);
    let [width, height] = header.size.map(|edge| (edge >> level).max(1));
    if header.supercompression == ZSTANDARD {
        let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
        if Header::level(bytes, level).is_none_or(|[.., length]| length != blocks * UASTC_BLOCK) {
            return Err("its header contradicts itself".into());
        }
    }
    let count = width as usize * height as usize;
    let mut texels = room(count)?;
    texels.resize(count, [0; 4]);
    // The decoder looks through the writer's notes and may trip over their lengths; nothing in them is needed.
    let mut plain = bytes.to_vec();
    plain[NOTES].fill(0);
    Transcoder::new(&plain)
        .and_then(|decoder| {
            let out = bytemuck::cast_slice_mut(&mut texels);
            decoder.transcode_into(level, TargetFormat::Rgba32, DecodeFlags::NONE, out)
        })
        .map_err(|_| "its texels are damaged; compress it again")?;
    if header.is_red_green() {
        texels.iter_mut().for_each(|texel| *texel = [texel[0], texel[3], 0, 255]);
    }
    Ok((Image { texels, width, height }, level))
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLORS: &[u8] = include_bytes!("../../../fuzz/corpus/ktx2/good-etc1s");
    const PLAIN: &[u8] = include_bytes!("../../../fuzz/corpus/ktx2/good-uastc");
    /// A header's fields by their places (KTX File Format Specification 2.0, 3 "Structure").
    const FORMAT: usize = 12;
    const WIDTH: usize = 20;
    const LAYERS: usize = 32;
    const FACES: usize = 36;
    const HEIGHT: usize = 24;
    const LEVELS: usize = 40;

    fn with(file: &[u8], place: usize, value: u32) -> Vec<u8> {
        let mut file = file.to_vec();
        file[place..place + 4].copy_from_slice(&value.to_le_bytes());
        file
    }

    fn mean(image: &Image, channel: usize) -> f64 {
        let sum: f64 = image.texels.iter().map(|texel| f64::from(texel[channel])).sum();
        sum / image.texels.len() as f64
    }

    #[test]
    fn smaller_levels_are_those_of_the_file() {
        for file in [COLORS, PLAIN] {
            let full = Image::decode(file).unwrap();
            assert_eq!((full.width, full.height), (16, 16));
            for halvings in 1..5 {
                let image = Image::decode_halved(file, halvings).unwrap();
                let edge = 16 >> halvings;
                assert_eq!((image.width, image.height, image.texels.len() as u32), (edge, edge, edge * edge));
                assert!((mean(&image, 1) - mean(&full, 1)).abs() < 40.0, "{halvings}");
            }
        }
        // Where the file has one level, ours are made of it.
        let single = Image::decode_halved(&with(PLAIN, LEVELS, 1), 2).unwrap();
        assert_eq!(single, Image::decode(PLAIN).unwrap().halved(2));
    }

    #[test]
    fn red_and_green_are_found_where_they_are_kept() {
        let full = Image::decode(COLORS).unwrap();
        assert!(
            full.texels.iter().any(|texel| texel[3] == 0) && full.texels.iter().any(|texel| texel[3] > 0)
        );
        let dfd = u32::from_le_bytes(COLORS[48..52].try_into().unwrap()) as usize;
        // The second sample's channel: 4 in place of 15, coverage.
        let mut two = COLORS.to_vec();
        assert_eq!(two[dfd + 28 + 16 + 3] & 15, 15);
        two[dfd + 28 + 16 + 3] = ETC1S_GREEN;
        let two = Image::decode(&two).unwrap();
        for (two, four) in two.texels.iter().zip(&full.texels) {
            assert_eq!(*two, [four[0], four[3], 0, 255]);
        }
    }

    #[test]
    fn what_is_no_single_picture_is_refused_in_words() {
        let refused = |place, value| Image::decode(&with(PLAIN, place, value)).unwrap_err();
        assert!(refused(FORMAT, 37).contains("ETC1S and UASTC are read"));
        assert!(refused(LAYERS, 2).contains("several pictures"));
        assert!(refused(FACES, 6).contains("several pictures"));
        assert!(refused(WIDTH, 16_385).contains("16385x16"));
        let small = with(&with(PLAIN, WIDTH, 8), HEIGHT, 8);
        assert!(Image::decode(&small).unwrap_err().contains("5 levels, but its size allows 4"));
        let cut = Image::decode(&PLAIN[..PLAIN.len() - 1]).unwrap_err();
        assert!(cut.contains("ends before"), "{cut}");
        let mut damaged = COLORS.to_vec();
        let global = u64::from_le_bytes(damaged[64..72].try_into().unwrap()) as usize;
        damaged[global + 120..].iter_mut().for_each(|byte| *byte ^= 0x5A);
        assert!(Image::decode(&damaged).unwrap_err().contains("texels are damaged"));
    }
}
