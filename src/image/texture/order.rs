//! In which order an image's texels lie in memory.
//!
//! Rows are good for who reads rows. Who looks up here and there wants neighbours close together, in both directions: so
//! large images are kept in squares of 4 x 4 texels, 8 x 8 of which make a square of 32 x 32. What is around a place is
//! then in one or two lines of the cache, and on one page of memory, where rows would be as many lines and pages as
//! they are. A square's texels take the place of as many rows' texels, so an image is put in order where it is.

use rayon::prelude::*;

/// The side of the small squares, and of the large ones.
const SMALL: u32 = 4;
const LARGE: u32 = 32;

/// Images of fewer texels stay in rows: they fit into caches.
const FEWEST: u64 = 1 << 18;

/// Where the texel in column `x` and row `y` is: the sum of what [`column`](Self::column) and [`row`](Self::row) tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TexelOrder {
    is_rows: bool,
    width: u32,
}

impl TexelOrder {
    /// Row by row.
    pub(super) fn rows(width: u32) -> Self {
        Self {
            is_rows: true,
            width,
        }
    }

    /// Whether it is row by row.
    #[inline]
    pub fn is_rows(&self) -> bool {
        self.is_rows
    }

    /// What is to be added for `x`, for a fourth of it and for a 32nd, both rounded down, each times these.
    #[inline]
    pub fn across(&self) -> [u32; 3] {
        if self.is_rows {
            return [1, 0, 0];
        }
        // 4 x 4 texels for each 4 columns, and what is missing to 32 x 32 for each 32.
        let small = SMALL * SMALL - SMALL;
        let large = LARGE * LARGE - LARGE / SMALL * SMALL * SMALL;
        [1, small, large]
    }

    /// The same for `y`.
    #[inline]
    pub fn down(&self) -> [u32; 3] {
        if self.is_rows {
            return [self.width, 0, 0];
        }
        let small = LARGE * SMALL - SMALL * SMALL;
        let large = LARGE * self.width - LARGE * LARGE;
        [SMALL, small, large]
    }

    #[inline]
    fn along([one, small, large]: [u32; 3], i: u32) -> usize {
        let [one, small, large] = [one, small, large].map(|by| by as usize);
        one * i as usize + small * (i / SMALL) as usize + large * (i / LARGE) as usize
    }

    /// How many texels columns to the left of `x` take.
    #[inline]
    pub fn column(&self, x: u32) -> usize {
        Self::along(self.across(), x)
    }

    /// How many texels rows above `y` take.
    #[inline]
    pub fn row(&self, y: u32) -> usize {
        Self::along(self.down(), y)
    }

    /// Puts an image that is in rows, of so many numbers a texel, in the order that suits it best.
    pub(super) fn arrange<T: Copy + Send + Sync>(
        size: [u32; 2],
        channels: usize,
        pixels: &mut [T],
    ) -> Self {
        let [width, height] = size;
        let rows = Self::rows(width);
        let texels = u64::from(width) * u64::from(height);
        if texels < FEWEST || width % LARGE != 0 || height % LARGE != 0 {
            return rows;
        }
        let order = Self {
            is_rows: false,
            width,
        };
        let of_band = |band: &mut [T]| {
            let old = band.to_vec();
            for y in 0..LARGE {
                for x in (0..width).step_by(SMALL as usize) {
                    let [from, to] = [rows, order].map(|o| channels * (o.row(y) + o.column(x)));
                    let count = channels * SMALL as usize;
                    band[to..to + count].copy_from_slice(&old[from..from + count]);
                }
            }
        };
        pixels
            .par_chunks_exact_mut(channels * (LARGE * width) as usize)
            .for_each(of_band);
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_where_the_order_says() {
        for (size, channels) in [
            ([512, 512], 1),
            ([1024, 256], 3),
            ([100, 7], 2),
            ([513, 512], 1),
        ] {
            let [width, height] = size;
            let count = (width * height) as usize;
            let number = |texel: usize, c: usize| (4 * texel + c) as u32;
            let mut pixels: Vec<u32> = (0..count)
                .flat_map(|texel| (0..channels).map(move |c| number(texel, c)))
                .collect();
            let order = TexelOrder::arrange(size, channels, &mut pixels);
            assert_eq!(order.is_rows(), width < 512 || width % 32 != 0);
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let at = channels * (order.row(y) + order.column(x));
                for c in 0..channels {
                    assert_eq!(pixels[at + c], number((y * width + x) as usize, c));
                }
            }
        }
    }
}
