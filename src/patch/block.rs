//! Blocks: squares of 2^k x 2^k texels of one chart, aligned on the page.
//!
//! Patches lie in Morton order within each chart, so that a block is a run of consecutive patches.

use super::Ground;
use std::ops::Range;

impl Ground<'_> {
    /// The column and row of patch `i` on its page [texels].
    pub fn column_row(&self, i: usize) -> [u32; 2] {
        let [page, texel] = self.patches.texel(i);
        let width = self.atlas.pages[page as usize][0];
        [texel % width, texel / width]
    }

    /// The runs of patches that make up the blocks of 2^`level` texels a side, in order.
    pub fn blocks(&self, level: u32) -> Vec<Range<usize>> {
        let place = |i: usize| (self.patches.chart[i], self.column_row(i).map(|c| c >> level));
        let mut blocks: Vec<Range<usize>> = Vec::new();
        let mut last = None;
        for i in 0..self.patches.len() {
            let here = place(i);
            match blocks.last_mut() {
                Some(block) if last == Some(here) => block.end = i + 1,
                _ => blocks.push(i..i + 1),
            }
            last = Some(here);
        }
        blocks
    }

    /// The patches of the same chart in the texels next to patch `i`, at a side or a corner: eight at most.
    pub fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> {
        let page = self.patches.page(i) as usize;
        let [width, height] = self.atlas.pages[page];
        let [x, y] = self.column_row(i);
        let (columns, rows) = (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
        rows.flat_map(move |y| columns.clone().map(move |x| (y * width + x) as usize))
            .filter_map(move |texel| self.patches.at(page, texel))
            .filter(move |&j| j != i && self.patches.chart[j] == self.patches.chart[i])
    }
}
