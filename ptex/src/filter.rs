//! Filters: what a texture is around a point of a face, over an area of a given size.
//!
//! Burley and Lacewell 2008, section 5: a kernel is laid over the texels of one face, at the reduction that suits its
//! width. Where it reaches past an edge, that part of it is cut off, turned into the frame of the face beyond and laid
//! over that face's texels; the face's own adjacency is all that is needed, and no seam shows. `kernel` has the weights,
//! `spread` cuts and turns, `corner` knows what lies across a vertex, `triangle` is the other filter, for meshes of
//! triangles. Results agree with files' original library; [`Consistent`] is a lookup of our own beside them, for
//! displacement, of which every face that shares an edge sees the same bits.

mod consistent;
mod corner;
mod kernel;
mod spread;
mod triangle;

use std::str::FromStr;

pub use consistent::{Consistent, FaceBounds};

use crate::error::{Error, Result};
use crate::reader::Reader;
use crate::types::{BorderMode, MeshType, Res};

use kernel::{Shape, clamped_floor, scale};
use spread::{Kernel, Spread};

/// Which kernel is laid over the texels. Meshes of triangles know two only: point, and one that all others stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FilterKind {
    /// The texel that the point is in.
    Point,
    /// The nearest two texels along each axis.
    Bilinear,
    /// The mean of the area.
    Box,
    /// exp(-2 x²), cut off at two widths.
    Gaussian,
    /// A cubic whose [`Filter::sharpness`] is from 0, as [`FilterKind::BSpline`], to 1, as [`FilterKind::CatmullRom`].
    Bicubic,
    /// The uniform cubic B-spline: the smoothest.
    BSpline,
    /// The cubic that interpolates: the sharpest.
    CatmullRom,
    /// Mitchell and Netravali's compromise: two thirds sharp.
    Mitchell,
}

impl FilterKind {
    /// All kinds with their names.
    pub const NAMES: [(&str, Self); 8] = [
        ("point", Self::Point),
        ("bilinear", Self::Bilinear),
        ("box", Self::Box),
        ("gaussian", Self::Gaussian),
        ("bicubic", Self::Bicubic),
        ("bspline", Self::BSpline),
        ("catmullrom", Self::CatmullRom),
        ("mitchell", Self::Mitchell),
    ];
}

impl FromStr for FilterKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = Self::NAMES.iter().find(|(known, _)| *known == name);
        found.map(|(_, kind)| *kind).ok_or_else(|| {
            let names = Self::NAMES.map(|(name, _)| name).join(", ");
            Error::request(
                format!("there is no filter `{name}`"),
                format!("use one of {names}"),
            )
        })
    }
}

/// A filter with its options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    /// The kernel.
    pub kind: FilterKind,
    /// For [`FilterKind::Bicubic`]: 0 to 1.
    pub sharpness: f32,
    /// Blends between reductions, so that nothing jumps as widths change. Not for point, bilinear and box.
    pub lerp: bool,
    /// Goes on in the neighbours. Without it every face of a mesh of quads is filtered as if it had none; in meshes of
    /// triangles it has no effect.
    pub edge_blend: bool,
    /// Multiplies the widths of lookups.
    pub width: f32,
    /// Is added to the widths of lookups, in units of a face that is no sub-face.
    pub blur: f32,
}

impl Filter {
    /// A filter without sharpness, blending between reductions, widening and blur; edges are blended.
    #[must_use]
    pub fn new(kind: FilterKind) -> Self {
        Self {
            kind,
            sharpness: 0.0,
            lerp: false,
            edge_blend: true,
            width: 1.0,
            blur: 0.0,
        }
    }

    /// Filters around (`u`, `v`) of a face, in units of the face, and sets `out` to as many channels from
    /// `first_channel` on; 1 is what is stored as 255, 65535 or 1. `w` are the two vectors, (`w[0]`, `w[1]`) and
    /// (`w[2]`, `w[3]`), that span the area: to its neighbours in a picture, say. `premultiply` multiplies colours with
    /// alpha where the file has one.
    ///
    /// Outside 0 to 1, `u` and `v` are clamped, wrapped, or lead into blackness, as the file's border modes say.
    ///
    /// # Errors
    /// If there is no such face or channel, an argument is not finite, or the file turns out to be damaged.
    #[allow(clippy::too_many_arguments)]
    pub fn eval(
        &self,
        reader: &Reader,
        face: u32,
        u: f32,
        v: f32,
        w: [f32; 4],
        first_channel: usize,
        premultiply: bool,
        out: &mut [f32],
    ) -> Result<()> {
        check(
            reader,
            face,
            [u, v, w[0], w[1], w[2], w[3]],
            first_channel,
            out.len(),
        )?;
        out.fill(0.0);
        let mut target = Target {
            reader,
            premultiply,
            first_channel,
            out,
        };
        let weight = match reader.mesh_type() {
            _ if self.kind == FilterKind::Point => target.point(face, u, v)?,
            MeshType::Triangle => triangle::eval(self, &mut target, face, [u, v], w)?,
            MeshType::Quad => self.quad(&mut target, face, [u, v], w)?,
        };
        target.normalise(weight);
        Ok(())
    }

    /// Returns the sum of the weights.
    fn quad(&self, target: &mut Target, face: u32, uv: [f32; 2], w: [f32; 4]) -> Result<f32> {
        let modes = target.reader.border_modes();
        let (Some(u), Some(v)) = (bordered(uv[0], modes.0), bordered(uv[1], modes.1)) else {
            return Ok(1.0);
        };
        let info = target.reader.face(face);
        if info.constant_neighbourhood {
            return target.constant(face);
        }
        // A sub-face is filtered as a quarter of the face that it would be part of.
        let (part, more) = if info.subface { (0.5, 1) } else { (1.0, 0) };
        let blur = self.blur / part;
        let width = |a: f32, b: f32| ((a.abs() + b.abs()) * self.width + blur) * part;
        let shape = Shape {
            kind: self.kind,
            sharpness: self.sharpness,
            lerp: self.lerp,
        };
        let (wu, wv) = (width(w[0], w[2]), width(w[1], w[3]));
        let mut kernel = Kernel::new(
            shape.taps(u * part, wu, info.res.ulog2 + more),
            shape.taps(v * part, wv, info.res.vlog2 + more),
        );
        if info.subface {
            kernel.u.onto_half();
            kernel.v.onto_half();
        }
        Spread::new(target).start(kernel, face, self.edge_blend)
    }
}

/// Where a coordinate is read, if not in the dark.
fn bordered(x: f32, mode: BorderMode) -> Option<f32> {
    match mode {
        BorderMode::Clamp => Some(x.clamp(0.0, 1.0)),
        BorderMode::Periodic => Some(x - x.floor()),
        BorderMode::Black => (x > -1.0 && x < 2.0).then_some(x),
    }
}

fn check(
    reader: &Reader,
    face: u32,
    numbers: [f32; 6],
    first_channel: usize,
    channels: usize,
) -> Result<()> {
    if face >= reader.face_count() {
        return Err(Error::request(
            format!(
                "face {face} is asked for, and there are {}",
                reader.face_count()
            ),
            "ask for a face of the file",
        ));
    }
    let fits = first_channel
        .checked_add(channels)
        .is_some_and(|end| end <= reader.channels());
    if !fits || channels == 0 {
        return Err(Error::request(
            format!(
                "{channels} channels from {first_channel} on are asked for, and there are {}",
                reader.channels()
            ),
            "ask for channels of the file",
        ));
    }
    if let Some(number) = numbers.iter().find(|n| !n.is_finite()) {
        return Err(Error::request(
            format!("a coordinate or width is {number}"),
            "ask with finite numbers",
        )
        .at_face(face));
    }
    Ok(())
}

/// What texels are added to, and where they come from.
struct Target<'a> {
    reader: &'a Reader,
    premultiply: bool,
    first_channel: usize,
    out: &'a mut [f32],
}

impl Target<'_> {
    /// Adds the texel that a point is in, with weight 1.
    fn point(&mut self, face: u32, u: f32, v: f32) -> Result<f32> {
        let res = self.reader.face(face).res;
        let (mut x, mut y) = (
            clamped_floor(u * scale(res.ulog2), res.ulog2),
            clamped_floor(v * scale(res.vlog2), res.vlog2),
        );
        if self.reader.mesh_type() == MeshType::Triangle {
            let n = 1 << res.ulog2;
            let beyond =
                u.clamp(0.0, 1.0) * n as f32 - x as f32 + v.clamp(0.0, 1.0) * n as f32 - y as f32;
            if beyond > 1.0 {
                (x, y) = (n - 1 - y, n - 1 - x);
            }
        }
        let texels = self.reader.texels(face, res, self.premultiply)?;
        texels.add(x as usize, y as usize, 1.0, self.first_channel, self.out)?;
        Ok(1.0)
    }

    /// Adds the texel that stands for a whole face, with weight 1.
    fn constant(&mut self, face: u32) -> Result<f32> {
        let one = Res { ulog2: 0, vlog2: 0 };
        let texels = self.reader.texels(face, one, self.premultiply)?;
        texels.add(0, 0, 1.0, self.first_channel, self.out)?;
        Ok(1.0)
    }

    /// From a sum of weighted texels in stored units to their mean.
    fn normalise(&mut self, weight: f32) {
        let divisor = weight * self.reader.data_type().one();
        // Only where adjacency contradicts itself can nothing be left.
        let factor = if divisor == 0.0 { 0.0 } else { 1.0 / divisor };
        for value in self.out.iter_mut() {
            *value *= factor;
        }
    }
}
