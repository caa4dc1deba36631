//! Counter-based quasi-random sequences: a sample depends on (seed, stage, receiver, index) alone, so the same numbers come
//! out for any number of threads and any order of work.
//!
//! Owen-scrambled Sobol points (Burley 2020, "Practical Hash-based Owen Scrambling"), whose stratification in four
//! dimensions lowers the noise of a gather by a factor of three and more against independent numbers.

/// One scrambled sequence of 4D points.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    seed: u32,
}

/// Who draws: stages get unrelated sequences for the same receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stage {
    Unocclude = 1,
    Direct,
    Element,
    Probe,
    FormFactor,
    Gather,
    Hemicube,
    Path,
    BackPath,
    Guide,
    Reach,
    Block,
    BlockArea,
    Back,
    Openness,
    LightProbe,
    Emitted,
    Walk,
    LightWalk,
    Chain,
    Photon,
}

impl Sequence {
    /// Points a sequence holds; indices beyond are taken modulo this.
    pub const LENGTH: u32 = 1 << 16;

    /// The sequence of `stage` for the receiver `receiver` (a patch, element or pair number) under the user's `seed`.
    pub fn new(seed: u32, stage: Stage, receiver: u64) -> Self {
        let key = (u64::from(seed) << 32) ^ ((stage as u64) << 56) ^ receiver;
        let mixed = mix(key);
        Self { seed: (mixed ^ (mixed >> 32)) as u32 }
    }

    /// An unrelated sequence for the same receiver, by its number; 0: this one.
    pub fn apart(self, number: u32) -> Self {
        if number == 0 { self } else { Self { seed: self.hash(number) } }
    }

    /// Dimensions `4 set..4 set + 4` of point `index`, each in [0, 1).
    pub fn point(&self, index: u32, set: u32) -> [f32; 4] {
        sobol_burley::sample_4d(index % Self::LENGTH, set % sobol_burley::NUM_DIMENSION_SETS_4D, self.seed)
    }

    /// A hash of `salt` under this sequence's seed, for permutations.
    pub fn hash(&self, salt: u32) -> u32 {
        (mix((u64::from(self.seed) << 32) | u64::from(salt)) >> 16) as u32
    }
}

/// The finalizer of SplitMix64 (Steele, Lea, Flood 2014): every input bit reaches every output bit.
pub(super) fn mix(key: u64) -> u64 {
    let z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
