//! Numbers as few bits: Rice codes (Rice, Plaunt 1971), which suit numbers that are the rarer the larger they are.

/// Quotients from here on are written out instead: a single far number must not cost a line of ones.
const LONGEST: u32 = 24;

/// Bits, the most significant first.
#[derive(Default)]
pub struct BitWriter {
    bytes: Vec<u8>,
    pending: u64,
    count: u32,
}

impl BitWriter {
    /// Adds the lowest `bits` bits of `value`; up to 32.
    pub fn put(&mut self, value: u32, bits: u32) {
        debug_assert!(bits <= 32 && (bits == 32 || value >> bits == 0));
        self.pending = self.pending << bits | u64::from(value);
        self.count += bits;
        while self.count >= 8 {
            self.count -= 8;
            self.bytes.push((self.pending >> self.count) as u8);
        }
    }

    /// Adds `value` by its quotient over 2^k in ones, and the rest.
    pub fn put_rice(&mut self, value: u32, k: u32) {
        let quotient = value >> k;
        if quotient >= LONGEST {
            self.put((1 << LONGEST) - 1, LONGEST);
            self.put(value, 32);
            return;
        }
        self.put((1 << (quotient + 1)) - 2, quotient + 1);
        self.put(value & ((1 << k) - 1), k);
    }

    /// Adds a number of any size: the smaller, the shorter.
    pub fn put_any(&mut self, value: u32) {
        let width = 32 - value.leading_zeros();
        self.put_rice(width, 2);
        self.put(value, width);
    }

    /// Adds `values`, of which most are near their mean or below.
    pub fn put_all(&mut self, values: impl ExactSizeIterator<Item = u32> + Clone) {
        let sum: u64 = values.clone().map(u64::from).sum();
        let mean = sum / (values.len() as u64).max(1);
        // The best parameter for a geometric distribution is about the logarithm of 0.69 of its mean.
        let k = (mean * 11 / 16).checked_ilog2().map_or(0, |k| (k + 1).min(31));
        self.put(k, 5);
        values.for_each(|value| self.put_rice(value, k));
    }

    /// All of it, in whole bytes.
    pub fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push((self.pending << (8 - self.count)) as u8);
        }
        self.bytes
    }
}

/// Reads what a [`BitWriter`] wrote; past the end there is nothing.
pub struct BitReader<'a> {
    bytes: &'a [u8],
    /// The next byte to be taken in.
    next: usize,
    pending: u64,
    count: u32,
}

impl<'a> BitReader<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, next: 0, pending: 0, count: 0 }
    }

    /// Takes bytes in until there are more than 32 bits, or no bytes are left.
    fn fill(&mut self) {
        while self.count <= 56 && self.next < self.bytes.len() {
            self.pending = self.pending << 8 | u64::from(self.bytes[self.next]);
            (self.next, self.count) = (self.next + 1, self.count + 8);
        }
    }

    /// The next `bits` bits, up to 32.
    #[inline]
    pub fn get(&mut self, bits: u32) -> Option<u32> {
        if self.count < bits {
            self.fill();
        }
        self.count = self.count.checked_sub(bits)?;
        Some((self.pending >> self.count & ((1u64 << bits) - 1)) as u32)
    }

    /// What [`put_rice`](BitWriter::put_rice) added.
    #[inline]
    pub fn get_rice(&mut self, k: u32) -> Option<u32> {
        if self.count <= LONGEST {
            self.fill();
        }
        // The bits at the top of a word, with ones beyond the last as the end of a quotient is a zero.
        let top = !(self.pending << (64 - self.count.max(1)));
        let quotient = top.leading_zeros();
        if quotient >= LONGEST {
            self.get(LONGEST)?;
            return self.get(32);
        }
        self.get(quotient + 1)?;
        Some(quotient << k | self.get(k)?)
    }

    /// What [`put_any`](BitWriter::put_any) added.
    pub fn get_any(&mut self) -> Option<u32> {
        let width = self.get_rice(2)?;
        if width > 32 {
            return None;
        }
        self.get(width)
    }

    /// Calls `take` with each of the `count` numbers that [`put_all`](BitWriter::put_all) added.
    pub fn get_all(&mut self, count: usize, mut take: impl FnMut(u32) -> Option<()>) -> Option<()> {
        let k = self.get(5)?;
        for _ in 0..count {
            take(self.get_rice(k)?)?;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        let numbers = [0, 1, 2, 3, 7, 8, 250, 4096, 70_000, u32::MAX, 5, 0, 0, 1 << 31];
        let mut writer = BitWriter::default();
        writer.put(5, 3);
        writer.put_all(numbers.iter().copied());
        numbers.iter().for_each(|&n| writer.put_any(n));
        numbers.iter().for_each(|&n| writer.put(n, 32));
        let few = [3, 4, 5, 3, 2, 1];
        writer.put_all(few.iter().copied());
        let bytes = writer.finish();
        let mut reader = BitReader::new(&bytes);
        assert_eq!(reader.get(3), Some(5));
        let mut all = Vec::new();
        let mut take = |n| {
            all.push(n);
            Some(())
        };
        assert_eq!(reader.get_all(numbers.len(), &mut take), Some(()));
        assert_eq!(all, numbers);
        numbers.iter().for_each(|&n| assert_eq!(reader.get_any(), Some(n)));
        numbers.iter().for_each(|&n| assert_eq!(reader.get(32), Some(n)));
        let mut last = Vec::new();
        reader.get_all(few.len(), |n| {
            last.push(n);
            Some(())
        });
        assert_eq!(last, few);
        assert!(reader.get(32).is_none(), "past the end there is nothing");
    }

    #[test]
    fn a_geometric_distribution_takes_little_more_than_its_entropy() {
        // Gaps between 4,000 random places among a million: 9.4 bits each at best.
        let mut places: Vec<u32> = (0..4000u64).map(|k| (k * 0x9E37_79B9_7F4A_7C15 % 1_000_003) as u32).collect();
        places.sort_unstable();
        let gaps: Vec<u32> = places.windows(2).map(|w| w[1] - w[0]).collect();
        let mut writer = BitWriter::default();
        writer.put_all(gaps.iter().copied());
        let bits = 8.0 * writer.finish().len() as f64 / gaps.len() as f64;
        assert!(bits < 9.7, "{bits:.2} bits each");
    }
}
