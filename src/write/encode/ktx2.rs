//! KTX 2.0 files of one two-dimensional picture (Khronos, *KTX File Format Specification*, version 2.0), with the basic
//! data format descriptor that its format demands (Khronos, *Data Format Specification*, version 1.3, section 5).
//!
//! A file is: identifier, header, index of sections, index of levels, descriptor, key/value data, then the levels, the
//! smallest one first, each at a multiple of the texel block's size. Rows go down and no supercompression is used, so
//! that a level can be handed to a graphics processor as it stands.

/// The first bytes of any KTX 2 file (section 3.1).
const IDENTIFIER: [u8; 12] = [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', 0xBB, b'\r', b'\n', 0x1A, b'\n'];

/// Bytes of identifier, header and index of sections; of an entry in the index of levels.
const HEADER: usize = 80;
const LEVEL_ENTRY: usize = 24;

/// Half and unit float as a sample's limits (Data Format Specification, section 5.16): bits of -1 and 1.
const MINUS_ONE: u32 = 0xBF80_0000;
const ONE: u32 = 0x3F80_0000;

/// Bits of a sample's channel byte, above the channel's number.
const SIGNED: u32 = 0x40;
const FLOAT: u32 = 0x80;

/// What the levels hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `VK_FORMAT_R16G16B16A16_SFLOAT`.
    Rgba16Float,
    /// `VK_FORMAT_BC6H_UFLOAT_BLOCK`.
    Bc6hUfloat,
}

/// One level's texels.
#[derive(Clone, Debug)]
pub struct Level {
    pub bytes: Vec<u8>,
}

/// A sample of the data format descriptor: first bit, number of bits, channel with its qualifiers, least and greatest
/// value.
struct Sample {
    offset: u32,
    bits: u32,
    channel: u32,
    limits: [u32; 2],
}

impl Format {
    /// Vulkan's number of the format.
    fn vulkan(self) -> u32 {
        match self {
            Self::Rgba16Float => 97,
            Self::Bc6hUfloat => 143,
        }
    }

    /// Bytes of the type by which a file of other endianness would be swapped (section 3.3): 1 for blocks.
    fn type_size(self) -> u32 {
        match self {
            Self::Rgba16Float => 2,
            Self::Bc6hUfloat => 1,
        }
    }

    /// Texels along an edge of a texel block, and its bytes.
    fn block(self) -> (u32, usize) {
        match self {
            Self::Rgba16Float => (1, 8),
            Self::Bc6hUfloat => (4, 16),
        }
    }

    /// Number of the colour model: RGBSDA, BC6H.
    fn model(self) -> u32 {
        match self {
            Self::Rgba16Float => 1,
            Self::Bc6hUfloat => 133,
        }
    }

    fn samples(self) -> Vec<Sample> {
        match self {
            // Channels red, green, blue and alpha.
            Self::Rgba16Float => [0, 1, 2, 15]
                .into_iter()
                .enumerate()
                .map(|(i, channel)| Sample {
                    offset: 16 * i as u32,
                    bits: 16,
                    channel: channel | SIGNED | FLOAT,
                    limits: [MINUS_ONE, ONE],
                })
                .collect(),
            Self::Bc6hUfloat => vec![Sample { offset: 0, bits: 128, channel: FLOAT, limits: [0, ONE] }],
        }
    }

    /// The descriptor's total size and its one basic block: linear light of the primaries of BT.709, straight alpha.
    fn descriptor(self) -> Vec<u8> {
        const BT709: u32 = 1;
        const LINEAR: u32 = 1;
        const VERSION: u32 = 2;
        let samples = self.samples();
        let size = 24 + 16 * samples.len() as u32;
        let (side, bytes) = self.block();
        let mut words = vec![
            size + 4,
            0, // vendor Khronos, the basic descriptor
            VERSION | size << 16,
            self.model() | BT709 << 8 | LINEAR << 16,
            (side - 1) | (side - 1) << 8,
            bytes as u32,
            0,
        ];
        for sample in samples {
            words.extend([sample.offset | (sample.bits - 1) << 16 | sample.channel << 24, 0]);
            words.extend(sample.limits);
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

/// Bytes of a level of the size `size` [texels].
pub fn level_size(format: Format, [width, height]: [u32; 2]) -> usize {
    let (side, bytes) = format.block();
    width.div_ceil(side) as usize * height.div_ceil(side) as usize * bytes
}

/// The bytes of a file whose level 0 is `size` texels; each further level is half as large, rounded down. `own` are
/// keys and values beside the orientation and the writer, sorted by key, after `KTXwriter`.
///
/// # Panics
/// Where there is no level, or one of them has another size than its format demands.
pub fn file(format: Format, size: [u32; 2], levels: &[Level], own: &[(&str, &str)]) -> Vec<u8> {
    assert!(!levels.is_empty(), "a picture has a level");
    for (k, level) in levels.iter().enumerate() {
        let size = size.map(|n| (n >> k).max(1));
        assert_eq!(level.bytes.len(), level_size(format, size), "level {k} is {size:?} texels");
    }
    let descriptor = format.descriptor();
    let pairs = key_values(own);
    let descriptor_at = HEADER + LEVEL_ENTRY * levels.len();
    let pairs_at = descriptor_at + descriptor.len();
    let alignment = format.block().1;
    let mut at = pairs_at + pairs.len();
    let mut places = vec![0; levels.len()];
    for (k, level) in levels.iter().enumerate().rev() {
        at = at.next_multiple_of(alignment);
        places[k] = at;
        at += level.bytes.len();
    }
    let mut file = Vec::with_capacity(at);
    file.extend(IDENTIFIER);
    let word = |file: &mut Vec<u8>, v: u32| file.extend(v.to_le_bytes());
    let long = |file: &mut Vec<u8>, v: usize| file.extend((v as u64).to_le_bytes());
    // Depth, layers: none; one face; no supercompression.
    let header = [format.vulkan(), format.type_size(), size[0], size[1], 0, 0, 1, levels.len() as u32, 0];
    header.into_iter().for_each(|v| word(&mut file, v));
    [descriptor_at, descriptor.len(), pairs_at, pairs.len()].into_iter().for_each(|v| word(&mut file, v as u32));
    [0, 0].into_iter().for_each(|v| long(&mut file, v));
    for (place, level) in places.iter().zip(levels) {
        [*place, level.bytes.len(), level.bytes.len()].into_iter().for_each(|v| long(&mut file, v));
    }
    file.extend(descriptor);
    file.extend(pairs);
    for (place, level) in places.iter().zip(levels).rev() {
        file.resize(*place, 0);
        file.extend(&level.bytes);
    }
    file
}

/// Keys and values as the file has them (section 3.10): length, key and value with a zero behind each, padded to 4
/// bytes.
fn key_values(own: &[(&str, &str)]) -> Vec<u8> {
    let standard = [("KTXorientation", "rd"), ("KTXwriter", concat!("Lumel ", env!("CARGO_PKG_VERSION")))];
    let mut bytes = Vec::new();
    for (key, value) in standard.iter().chain(own) {
        let length = key.len() + value.len() + 2;
        bytes.extend((length as u32).to_le_bytes());
        bytes.extend(key.bytes().chain([0]).chain(value.bytes()).chain([0]));
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}
