//! Numbers in [0, 1) one after the other, for walks that don't know beforehand how many they take.

use super::sequence::{Sequence, Stage, mix};

/// What a walk draws from. Walks that draw the same numbers take the same way.
pub trait Numbers {
    /// The next number, in [0, 1).
    fn next(&mut self) -> f32;

    /// The next two.
    fn pair(&mut self) -> [f32; 2] {
        [self.next(), self.next()]
    }

    /// The next three.
    fn triple(&mut self) -> [f32; 3] {
        [self.next(), self.next(), self.next()]
    }
}

/// Point `index` of the sequences of one receiver, dimension by dimension: equal places in the walks of one receiver are spread
/// evenly over each other.
#[derive(Clone, Debug)]
pub struct Drawn {
    seed: u32,
    stage: Stage,
    receiver: u64,
    index: u32,
    sequence: Sequence,
    /// The set of four dimensions that comes next.
    set: u32,
    four: [f32; 4],
    taken: usize,
}

/// Numbers independent of each other, for chains, which evenly spread ones would lead astray (SplitMix64: Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Numbers of `stream` under the user's `seed`.
    pub fn new(seed: u32, stream: u64) -> Self {
        Self { state: mix(mix(u64::from(seed) ^ (u64::from(Stage::Chain as u32) << 56)) ^ stream) }
    }
}

impl Numbers for Random {
    fn next(&mut self) -> f32 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.state) >> 40) as f32 / (1u32 << 24) as f32
    }
}

/// Bits of a receiver's number; those above tell its sequences apart.
const RECEIVER_BITS: u32 = 40;

impl Drawn {
    /// Walk `index` of the receiver `receiver` (below 2^40) of `stage` under the user's `seed`.
    pub fn new(seed: u32, stage: Stage, receiver: u64, index: u64) -> Self {
        // A sequence ends after 2^16 points; the next ones belong to a sequence of its own.
        let beyond = (index / u64::from(Sequence::LENGTH)) & 0xff;
        let receiver = receiver | (beyond << RECEIVER_BITS);
        let sequence = Sequence::new(seed, stage, receiver);
        let index = (index % u64::from(Sequence::LENGTH)) as u32;
        Self { seed, stage, receiver, index, sequence, set: 0, four: [0.0; 4], taken: 4 }
    }
}

impl Numbers for Drawn {
    fn next(&mut self) -> f32 {
        if self.taken == self.four.len() {
            let sets = sobol_burley::NUM_DIMENSION_SETS_4D;
            if self.set > 0 && self.set.is_multiple_of(sets) {
                // Dimensions used twice would correlate the far ends of long walks.
                let block = u64::from(self.set / sets) << (RECEIVER_BITS + 8);
                self.sequence = Sequence::new(self.seed, self.stage, self.receiver ^ block);
            }
            self.four = self.sequence.point(self.index, self.set % sets);
            (self.set, self.taken) = (self.set + 1, 0);
        }
        self.taken += 1;
        self.four[self.taken - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walks_are_even_in_each_dimension_and_differ_from_each_other() {
        for dimension in [0, 1, 5, 300, 1000] {
            let mut counts = [0; 16];
            for index in 0..256 {
                let mut numbers = Drawn::new(7, Stage::Path, 3, index);
                let value = (0..=dimension).map(|_| numbers.next()).last().unwrap();
                counts[(value * 16.0) as usize] += 1;
            }
            assert!(counts.iter().all(|&n| n == 16), "{dimension}: {counts:?}");
        }
        let first = |receiver, index| Drawn::new(7, Stage::Path, receiver, index).next();
        assert_ne!(first(0, 0), first(1, 0));
        assert_ne!(first(0, 0), first(0, 1 << 16));
        assert_ne!(first(0, 0), first(0, 1));
    }
}
