//! A lookup of which all faces that share an edge or a vertex see the same bits: for displacement, which must not tear.
//!
//! The filters of Burley and Lacewell come close to the same value from both sides of an edge, but sum in another order
//! there, and around vertices where other than four faces meet they differ by more than rounding. This lookup is our
//! own. It is bilinear between the texels' middles, and what lies on the rim of a face belongs to nobody:
//!
//! - A *vertex* has one value: the mean over all faces around it of the texel in that corner, each weighted with how
//!   finely it divides its face, summed in the order of the faces.
//! - An *edge* has one function, which the side with the lower number evaluates, whoever asks. It joins the values of
//!   its vertices and, at every texel along the finer side, the mean of both sides there, weighted with how close their
//!   texels' middles come to the edge. Two faces of equal size get the middle; beside a much finer face a coarse one
//!   takes on that face's detail at the edge and loses it within half a texel.
//! - The half texel between the rim and the outermost middles is filled by interpolating from the edge's function to
//!   the row of middles. In a corner two such strips meet, along the line from the vertex to the middle of the texel.
//!
//! ```text
//!   +--.-----.-----.--      .  where the edge's function has its values
//!   | /|     |     |        +  vertex
//!   .--x-----x-----x--      x  middle of a texel
//!   |  |     |     |
//! ```
//!
//! Everything is an interpolation, never outside the texels around, and continuous. Where an edge of a face meets two
//! sub-faces it has two functions, and the vertex between them counts the face's two texels there among its corners.
//!
//! The same point of an edge is `t` for one side and `1 - t` for the other. These give the same bits if one is the
//! other's in single precision. Between a face and a sub-face, which see `t` and `(1 - t) / 2` or `1 - t / 2`, they do
//! so for multiples of 2^-23.
//!
//! Files lie: only where both faces name each other do they share an edge. Whoever is named and knows nothing of it
//! has a border there, at which a face's texels are repeated in every border mode. Tangent vectors are not turned.

mod bounds;
mod rim;
mod topology;

pub use bounds::FaceBounds;

use super::check;
use crate::error::{Error, Result};
use crate::reader::{Reader, Texels};
use crate::types::{MeshType, Res};

use rim::Rim;
use topology::{Side, Vertices};

/// Channels that are looked up together.
const LANES: usize = 4;
type Value = [f32; LANES];

/// The lookup. It knows the vertices of one file's mesh; all threads share it.
#[derive(Debug)]
pub struct Consistent {
    vertices: Vertices,
    level: u8,
    premultiply: bool,
}

impl Consistent {
    /// Prepares lookups in a file whose faces are read at their size halved `level` times along both axes, down to one
    /// texel. `premultiply` is that of [`Reader::texels`].
    ///
    /// # Errors
    /// If the file is of triangles.
    pub fn new(reader: &Reader, level: u8, premultiply: bool) -> Result<Self> {
        if reader.mesh_type() == MeshType::Triangle {
            return Err(Error::request(
                "consistent lookups are made in meshes of quads, and this one is of triangles",
                "use another filter, or write the texture for a mesh of quads",
            )
            .in_file(reader.path()));
        }
        Ok(Self {
            vertices: Vertices::new(reader),
            level,
            premultiply,
        })
    }

    /// Sets `out` to the texture at (`u`, `v`) of a face, as many channels from `first_channel` on; 1 is what is stored
    /// as 255, 65535 or 1. `u` and `v` are clamped to 0 to 1. `reader` is the one that this was made for.
    ///
    /// # Errors
    /// If there is no such face or channel, a coordinate is not finite, or the file turns out to be damaged.
    pub fn eval(
        &self,
        reader: &Reader,
        face: u32,
        u: f32,
        v: f32,
        first_channel: usize,
        out: &mut [f32],
    ) -> Result<()> {
        check(
            reader,
            face,
            [u, v, 0.0, 0.0, 0.0, 0.0],
            first_channel,
            out.len(),
        )?;
        self.vertices.check(reader)?;
        let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
        let one = reader.data_type().one();
        for (i, out) in out.chunks_mut(LANES).enumerate() {
            let lookup = Lookup {
                of: self,
                reader,
                first: first_channel + i * LANES,
                count: out.len(),
            };
            let value = lookup.at(face, u, v)?;
            for (out, value) in out.iter_mut().zip(value) {
                *out = value / one;
            }
        }
        Ok(())
    }

    /// What lookups in a face can give, for `channels` from `first_channel` on. What is finer than 2^`finest` texels is
    /// not told apart, to save memory: 8 bytes a channel for each such square, and a third more for the hierarchy.
    ///
    /// # Errors
    /// If there is no such face or channel, or the file turns out to be damaged.
    pub fn bounds(
        &self,
        reader: &Reader,
        face: u32,
        first_channel: usize,
        channels: usize,
        finest: u8,
    ) -> Result<FaceBounds> {
        check(reader, face, [0.0; 6], first_channel, channels)?;
        self.vertices.check(reader)?;
        FaceBounds::new(self, reader, face, first_channel, channels, finest)
    }

    fn res(&self, reader: &Reader, face: u32) -> Res {
        let full = reader.face(face).res;
        let level = i8::try_from(self.level).unwrap_or(i8::MAX);
        Res {
            ulog2: (full.ulog2 - level.min(full.ulog2)).max(0),
            vlog2: (full.vlog2 - level.min(full.vlog2)).max(0),
        }
    }
}

/// One lookup of a few channels. Values are in stored units.
struct Lookup<'a> {
    of: &'a Consistent,
    reader: &'a Reader,
    first: usize,
    count: usize,
}

/// The texels of one face.
struct Grid<'a> {
    texels: Texels<'a>,
    face: u32,
    /// Columns and rows.
    size: [usize; 2],
    /// How finely a whole face's length is divided, relative to others: twice as much in a sub-face, which is half as
    /// long.
    density: [f32; 2],
}

impl<'a> Lookup<'a> {
    fn at(&self, face: u32, u: f32, v: f32) -> Result<Value> {
        let grid = self.grid(face)?;
        let place = [u * grid.size[0] as f32, v * grid.size[1] as f32];
        match [near(place[0], grid.size[0]), near(place[1], grid.size[1])] {
            [None, None] => self.between(&grid, place),
            [None, Some(y)] => self.strip(&grid, [0, 2][y.end], u, y.inner, place),
            [Some(x), None] => self.strip(&grid, [3, 1][x.end], v, x.inner, place),
            // The vertex and the middle of its texel are joined by a line, and the nearer edge has this side of it.
            [Some(x), Some(y)] => {
                let corner = [[0, 3], [1, 2]][x.end][y.end];
                let (edge, along, out, to) = if y.inner <= x.inner {
                    ([0, 2][y.end], u, x.inner, y.inner)
                } else {
                    ([3, 1][x.end], v, y.inner, x.inner)
                };
                let rim = self.rim(&grid, edge, along)?;
                if to == 0.0 {
                    return Ok(rim);
                }
                let vertex = self.vertex(Side::new(face, corner))?;
                let middle = self.texel(&grid, grid.corner(corner))?;
                Ok(lerp(rim, lerp(vertex, middle, out), to / out))
            }
        }
    }

    /// Between an edge and the row of middles along it: `inner` is how far inside, from 0 to 1.
    fn strip(
        &self,
        grid: &Grid,
        edge: usize,
        along: f32,
        inner: f32,
        place: [f32; 2],
    ) -> Result<Value> {
        let rim = self.rim(grid, edge, along)?;
        if inner == 0.0 {
            return Ok(rim);
        }
        Ok(lerp(rim, self.between(grid, place)?, inner))
    }

    /// The function of an edge of a face, where the face's own coordinate along it is `along`.
    fn rim(&self, grid: &Grid, edge: usize, along: f32) -> Result<Value> {
        let t = if edge < 2 { along } else { 1.0 - along };
        let (rim, s) = Rim::at(self, Side::new(grid.face, edge), t);
        rim.eval(self, s)
    }

    /// Between the middles of texels, at a place in texels. Further out than the outermost middles nothing changes.
    fn between(&self, grid: &Grid, place: [f32; 2]) -> Result<Value> {
        let [(x, fx), (y, fy)] = [0, 1].map(|axis| {
            let last = (grid.size[axis] - 1) as f32;
            let p = (place[axis] - 0.5).clamp(0.0, last);
            (p as usize, p - p.floor())
        });
        let row = |y| -> Result<Value> {
            let value = self.texel(grid, [x, y])?;
            if fx == 0.0 {
                return Ok(value);
            }
            Ok(lerp(value, self.texel(grid, [x + 1, y])?, fx))
        };
        let value = row(y)?;
        if fy == 0.0 {
            return Ok(value);
        }
        Ok(lerp(value, row(y + 1)?, fy))
    }

    /// The value of the vertex at which an edge begins.
    fn vertex(&self, start: Side) -> Result<Value> {
        let mut sum = [0.0; LANES];
        let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        let mut weights = 0.0;
        for member in self.of.vertices.around(start) {
            let grid = self.grid(member.face)?;
            let weight = grid.density[0] * grid.density[1];
            let (texels, count) = member.texels(&grid);
            for at in &texels[..count] {
                let value = self.texel(&grid, *at)?;
                for i in 0..self.count {
                    sum[i] += weight * value[i];
                    low[i] = low[i].min(value[i]);
                    high[i] = high[i].max(value[i]);
                }
                weights += weight;
            }
        }
        // Rounding must not lead outside of what there is.
        Ok(std::array::from_fn(|i| {
            (sum[i] / weights).max(low[i]).min(high[i])
        }))
    }

    fn grid(&self, face: u32) -> Result<Grid<'a>> {
        let res = self.of.res(self.reader, face);
        let subface = self.reader.face(face).subface;
        let size = [1 << res.ulog2, 1 << res.vlog2];
        Ok(Grid {
            texels: self.reader.texels(face, res, self.of.premultiply)?,
            face,
            size,
            density: size.map(|n| n as f32 * if subface { 2.0 } else { 1.0 }),
        })
    }

    fn texel(&self, grid: &Grid, [x, y]: [usize; 2]) -> Result<Value> {
        let mut value = [0.0; LANES];
        grid.texels
            .add(x, y, 1.0, self.first, &mut value[..self.count])?;
        Ok(value)
    }
}

impl Grid<'_> {
    /// The texel at a corner.
    fn corner(&self, corner: usize) -> [usize; 2] {
        self.along(corner, 0)
    }

    /// Texels along an edge.
    fn length(&self, edge: usize) -> usize {
        self.size[edge & 1]
    }

    /// One of them, counted along the edge, which is counter-clockwise.
    fn along(&self, edge: usize, i: usize) -> [usize; 2] {
        let [last_x, last_y] = self.size.map(|n| n - 1);
        match edge {
            0 => [i, 0],
            1 => [last_x, i],
            2 => [last_x - i, last_y],
            _ => [0, last_y - i],
        }
    }
}

/// Closer to the low (0) or high (1) end of an axis than the outermost middle, and how far from the end to there.
struct Near {
    end: usize,
    inner: f32,
}

/// Where a place in texels is so close to an end.
fn near(place: f32, size: usize) -> Option<Near> {
    let from_end = size as f32 - place;
    if place < 0.5 {
        Some(Near {
            end: 0,
            inner: 2.0 * place,
        })
    } else if from_end < 0.5 {
        Some(Near {
            end: 1,
            inner: 2.0 * from_end,
        })
    } else {
        None
    }
}

/// From `a` to `b`; exactly `a` at 0.
fn lerp(a: Value, b: Value, t: f32) -> Value {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}
