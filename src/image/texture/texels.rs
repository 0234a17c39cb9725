//! The texels of one channel as they lie in memory, for whoever looks up many at once.
//!
//! The filter is that of [`Texture::eval`], but for roundings: bytes are multiplied by 1/255 rather than divided by 255,
//! and texels are blended as `a + (b - a) f`.

use super::{LINEAR, Layout, Pixels, TexelOrder, Texture};
use crate::image::Wrap;
use crate::math::Vec2;

/// One channel of an image at its full size.
#[derive(Debug, Clone, Copy)]
pub struct Texels<'a> {
    /// The image's texels, row 0 on top, all channels of each together, in the machine's byte order.
    pub bytes: &'a [u8],
    /// Where they are.
    pub order: TexelOrder,
    /// How a number is written.
    pub kind: TexelKind,
    /// Width and height.
    pub size: [u32; 2],
    /// Bytes that a texel takes.
    pub stride: usize,
    /// Where the first texel's channel is.
    pub first: usize,
    /// What is beyond the borders.
    pub wrap: [Wrap; 2],
}

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TexelKind {
    /// 0 to 255 for 0 to 1.
    Byte,
    /// Half a float.
    Half,
    /// A float.
    Float,
}

/// How a coordinate is brought near 0..1, where floats are fine enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fold {
    /// Whole numbers are taken off.
    Ones,
    /// Even whole numbers are taken off.
    Twos,
    /// It is kept between these.
    Within([f32; 2]),
}

/// What a byte is multiplied by.
pub const FROM_BYTE: f32 = 1.0 / 255.0;

impl Texture {
    /// Component `component`, 0 to 3, of a look-up, if it is a channel of a single image as it is in memory: no tiles of
    /// UDIM, no colours that must be decoded or turned, and below 2 GB.
    pub fn texels(&self, component: usize) -> Option<Texels<'_>> {
        let [tile] = self.tiles.as_slice() else {
            return None;
        };
        let channel = match tile.layout {
            Layout::Grey => (component < 3).then_some(0)?,
            Layout::GreyAlpha => usize::from(component == 3),
            Layout::Two => (component < 2).then_some(component)?,
            Layout::Rgb => (component < 3).then_some(component)?,
            Layout::Rgba => component,
        };
        let is_linear =
            channel >= tile.layout.colors() || std::ptr::eq(tile.color, &raw const *LINEAR);
        let (bytes, kind, width): (&[u8], _, _) = match &tile.pixels {
            Pixels::Byte(pixels) => (pixels, TexelKind::Byte, 1),
            Pixels::Half(pixels) => {
                let bits: &[u16] =
                    half::slice::HalfFloatSliceExt::reinterpret_cast(pixels.as_slice());
                (bytemuck::cast_slice(bits), TexelKind::Half, 2)
            }
            Pixels::Float(pixels) => (bytemuck::cast_slice(pixels), TexelKind::Float, 4),
        };
        let usable = !self.udim
            && self.rec709_from_image.is_none()
            && (kind != TexelKind::Byte || is_linear)
            && bytes.len() < 1 << 31;
        usable.then_some(Texels {
            bytes,
            order: tile.order,
            kind,
            size: tile.size,
            stride: width * tile.layout.channels(),
            first: width * channel,
            wrap: self.wrap,
        })
    }
}

impl Texels<'_> {
    /// The number of a texel; row 0 is on top.
    #[inline]
    pub fn value(&self, x: u32, row: u32) -> f32 {
        let at = (self.order.row(row) + self.order.column(x)) * self.stride + self.first;
        match self.kind {
            TexelKind::Byte => f32::from(self.bytes[at]) * FROM_BYTE,
            TexelKind::Half => {
                let bits = u16::from_ne_bytes([self.bytes[at], self.bytes[at + 1]]);
                half::f16::from_bits(bits).to_f32()
            }
            TexelKind::Float => {
                let four = &self.bytes[at..at + 4];
                f32::from_ne_bytes([four[0], four[1], four[2], four[3]])
            }
        }
    }

    /// The texel of an index along an axis, columns from the left or rows from below, which may be beyond the borders;
    /// none where all is black.
    #[inline]
    pub fn place(&self, axis: usize, i: i64) -> Option<u32> {
        let size = i64::from(self.size[axis]);
        let i = match self.wrap[axis] {
            Wrap::Black => (0..size).contains(&i).then_some(i)?,
            Wrap::Clamp => i.clamp(0, size - 1),
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * size);
                i.min(2 * size - 1 - i)
            }
        };
        // In 0..size by now.
        u32::try_from(i).ok()
    }

    /// The numbers of the four texels around a place: columns `x` and the next, rows `y` from below and the next.
    #[inline]
    pub fn four(&self, x: i64, y: i64) -> [[f32; 2]; 2] {
        let columns = [self.place(0, x), self.place(0, x + 1)];
        let rows = [self.place(1, y), self.place(1, y + 1)];
        rows.map(|y| {
            columns.map(|x| match (x, y) {
                (Some(x), Some(y)) => self.value(x, self.size[1] - 1 - y),
                _ => 0.0,
            })
        })
    }

    /// How coordinates along an axis are brought near 0..1.
    #[inline]
    pub fn fold(&self, axis: usize) -> Fold {
        match self.wrap[axis] {
            Wrap::Black => Fold::Within([-1.0, 2.0]),
            Wrap::Clamp => Fold::Within([0.0, 1.0]),
            Wrap::Repeat => Fold::Ones,
            Wrap::Mirror => Fold::Twos,
        }
    }

    /// The value at `st`, bilinearly filtered.
    #[inline]
    pub fn eval(&self, st: Vec2) -> f32 {
        let at = |axis: usize, s: f32| {
            let s = match self.fold(axis) {
                Fold::Within([low, high]) => s.clamp(low, high),
                Fold::Ones => s - s.floor(),
                Fold::Twos => s - 2.0 * (0.5 * s).floor(),
            };
            let x = s * self.size[axis] as f32 - 0.5;
            (x.floor(), x - x.floor())
        };
        let ((x, fx), (y, fy)) = (at(0, st.x), at(1, st.y));
        let [low, high] = self.four(x as i64, y as i64).map(|[a, b]| a + (b - a) * fx);
        low + (high - low) * fy
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::surface::tests::shapes::{Random, noise};

    #[test]
    fn a_channel_is_what_a_look_up_gives() {
        let mut random = Random(5);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp, Wrap::Black] {
            for (names, component) in [("Y", 0), ("Y", 2), ("RGB", 1)] {
                let texture = noise([37, 23], names, wrap, 5);
                let texels = texture.texels(component).expect("it is as in memory");
                for _ in 0..1000 {
                    let st = Vec2::new(random.next(), random.next()) * 4.0 - 1.5;
                    let (a, b) = (texels.eval(st), texture.eval(st)[component]);
                    assert!((a - b).abs() < 1e-5, "{wrap:?} {st}: {a} {b}");
                }
            }
        }
        assert!(Texture::constant(Vec4::ONE).texels(3).is_some());
    }
}
