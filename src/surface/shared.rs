//! Grids of displaced points, and the points that faces share.
//!
//! **Shared samples have one owner.** A point on an edge or vertex is evaluated once, and all faces there take its
//! bits. Its limit point comes from the owner, the lowest face at the edge that is not a hole, walked in the edge's
//! own direction. Its displacement is the mean of the displacements that the faces have there, in the order of their
//! numbers: on a smooth surface with a continuous texture they all agree, and the mean is each of them. At a crease,
//! where the faces have different normals, the point lies between the two sheets that their displacement tears apart,
//! and the micro-quads next to the edge bridge them: a bevel one micro-quad wide. At a seam of the texture it has the
//! mean height of both sides.

use rayon::prelude::*;

use super::base::{LimitGrid, Texcoord, TexcoordGrid, edge_uv};
use super::displace::{Amount, Displacement, DisplacementPoint, MapGrid, Space};
use super::evaluate::{SINE, Surface, Tangents, unit_normal};
use super::rates::Rates;
use crate::math::{Bounds3, Vec2, Vec3};

/// Room to work in; keep one per thread.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    pub(super) us: Vec<f32>,
    pub(super) vs: Vec<f32>,
    limit: LimitGrid,
    normal: [Vec<f32>; 3],
    texcoords: TexcoordGrid,
    /// Displacements; limit point plus displacement is the displaced point.
    moved: Vec<Vec3>,
    sum: Vec<Vec3>,
    pub(super) line: Vec<Vec3>,
}

/// The points that faces share, at one motion key: all of them, or those of vertices alone.
#[derive(Debug, Clone)]
pub struct SharedSamples {
    vertices: Vec<Vec3>,
    /// Where each edge's inner samples start; empty if those are not held.
    starts: Vec<usize>,
    samples: Vec<Vec3>,
}

impl SharedSamples {
    /// Evaluates them all, on all threads.
    pub fn new(surface: &Surface, rates: &Rates, key: u32) -> Self {
        let vertices = vertices(surface, key);
        let mut starts = vec![0];
        let mut count = 0;
        for edge in 0..surface.adjacency.edge_count() {
            count += rates.edge(edge) as usize - 1;
            starts.push(count);
        }
        let mut samples = vec![Vec3::ZERO; count];
        let edges: Vec<(u32, &mut [Vec3])> = (0..).zip(split(&mut samples, &starts)).collect();
        edges.into_par_iter().with_min_len(16).for_each_init(
            Scratch::default,
            |scratch, (edge, samples)| {
                surface.edge_points(edge, key, scratch, samples);
            },
        );
        Self {
            vertices,
            starts,
            samples,
        }
    }

    /// Those of vertices at each motion key, and the box around these and what is within edges, none of which is held.
    pub fn of_vertices(surface: &Surface, rates: &Rates) -> (Vec<Self>, Bounds3) {
        let mut bounds = Bounds3::EMPTY;
        let keys = (0..surface.base().keys())
            .map(|key| {
                let vertices = vertices(surface, key);
                for (vertex, &point) in (0..).zip(&vertices) {
                    if surface.adjacency.vertex(vertex).len() > 0 {
                        bounds = bounds.including(point);
                    }
                }
                let on_edges = (0..surface.adjacency.edge_count())
                    .into_par_iter()
                    .filter(|&edge| surface.adjacency.edge(edge).len() > 0)
                    .map_init(
                        || (Scratch::default(), Vec::new()),
                        |(scratch, samples), edge| {
                            samples.clear();
                            samples.resize(rates.edge(edge) as usize - 1, Vec3::ZERO);
                            surface.edge_points(edge, key, scratch, samples);
                            Bounds3::of(samples.iter().copied())
                        },
                    )
                    .reduce(|| Bounds3::EMPTY, Bounds3::union);
                bounds = bounds.union(on_edges);
                Self {
                    vertices,
                    starts: Vec::new(),
                    samples: Vec::new(),
                }
            })
            .collect();
        (keys, bounds)
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        size_of_val(self.vertices.as_slice())
            + size_of_val(self.starts.as_slice())
            + size_of_val(self.samples.as_slice())
    }

    /// The box around what the faces that are no holes share, at all motion keys given.
    pub fn bounds(surface: &Surface, keys: &[Self]) -> Bounds3 {
        let base = surface.base();
        let faces = (0..base.faces()).filter(|&face| !base.is_hole(face));
        let edges = faces.flat_map(|face| (0..4).map(move |k| (face, k)));
        edges.fold(Bounds3::EMPTY, |bounds, (face, k)| {
            let walks = keys.iter().flat_map(|key| key.walk(surface, face, k));
            walks.fold(bounds, Bounds3::including)
        })
    }

    /// A vertex of the surface.
    pub fn vertex(&self, vertex: u32) -> Vec3 {
        self.vertices[vertex as usize]
    }

    /// Whether the points within edges are held.
    pub(super) fn holds_edges(&self) -> bool {
        !self.starts.is_empty()
    }

    /// The points within an edge, in its own direction: one fewer than its segments.
    ///
    /// # Panics
    /// If they are not held.
    pub fn edge(&self, edge: u32) -> &[Vec3] {
        let edge = edge as usize;
        &self.samples[self.starts[edge]..self.starts[edge + 1]]
    }

    /// The points along edge `k` of a face, from corner `k` to the next one, both ends included.
    pub fn walk(
        &self,
        surface: &Surface,
        face: u32,
        k: u32,
    ) -> impl ExactSizeIterator<Item = Vec3> + '_ {
        let used = surface.base().edge(face, k);
        let samples = self.edge(used.edge);
        let ends = [k, (k + 1) % 4].map(|k| self.vertex(surface.base().vertex(face, k)));
        let segments = samples.len() + 1;
        (0..segments + 1).map(move |i| {
            if i == 0 {
                ends[0]
            } else if i == segments {
                ends[1]
            } else if used.reversed {
                samples[segments - 1 - i]
            } else {
                samples[i - 1]
            }
        })
    }
}

fn vertices(surface: &Surface, key: u32) -> Vec<Vec3> {
    let mut vertices = vec![Vec3::ZERO; surface.adjacency.vertex_count() as usize];
    vertices
        .par_iter_mut()
        .with_min_len(64)
        .enumerate()
        .for_each_init(Scratch::default, |scratch, (vertex, point)| {
            *point = surface.vertex_point(vertex as u32, key, scratch);
        });
    vertices
}

/// Cuts `all` at `starts`, whose last one is its end.
pub(super) fn split<'a, T>(mut all: &'a mut [T], starts: &[usize]) -> Vec<&'a mut [T]> {
    starts
        .windows(2)
        .map(|ends| {
            let (head, tail) = std::mem::take(&mut all).split_at_mut(ends[1] - ends[0]);
            all = tail;
            head
        })
        .collect()
}

impl Surface {
    /// The shared points that cut an edge into one more segments than `out` is long, in the edge's own direction.
    pub(super) fn edge_points(&self, edge: u32, key: u32, scratch: &mut Scratch, out: &mut [Vec3]) {
        self.edge_part(edge, out.len() + 1, 1, key, scratch, out);
    }

    /// Some of the points that cut an edge into so many segments, from number `first` on.
    pub(super) fn edge_part(
        &self,
        edge: u32,
        segments: usize,
        first: usize,
        key: u32,
        scratch: &mut Scratch,
        out: &mut [Vec3],
    ) {
        let segments = segments as f32;
        self.shared_points(
            self.adjacency.edge(edge),
            out,
            scratch,
            |scratch, side, out_len| {
                scratch.us.clear();
                scratch.vs.clear();
                for i in 0..out_len {
                    let t = (first + i) as f32 / segments;
                    let uv = edge_uv(side.k, if side.reversed { 1.0 - t } else { t });
                    // The other parameter is the same all along the edge.
                    if side.k % 2 == 0 || i == 0 {
                        scratch.us.push(uv.x);
                    }
                    if side.k % 2 == 1 || i == 0 {
                        scratch.vs.push(uv.y);
                    }
                }
                self.displace_grid(side.face, key, scratch);
            },
        );
    }

    /// The shared point of a vertex.
    pub(super) fn vertex_point(&self, vertex: u32, key: u32, scratch: &mut Scratch) -> Vec3 {
        let mut point = [Vec3::ZERO];
        self.shared_points(
            self.adjacency.vertex(vertex),
            &mut point,
            scratch,
            |scratch, side, _| {
                let uv = edge_uv(side.k, 0.0);
                scratch.us.clear();
                scratch.us.push(uv.x);
                scratch.vs.clear();
                scratch.vs.push(uv.y);
                self.displace_grid(side.face, key, scratch);
            },
        );
        point[0]
    }

    /// The owner's limit points plus the mean of all sides' displacements. Numbers without sides give zeros.
    fn shared_points(
        &self,
        sides: impl ExactSizeIterator<Item = super::adjacency::Side>,
        out: &mut [Vec3],
        scratch: &mut Scratch,
        evaluate: impl Fn(&mut Scratch, super::adjacency::Side, usize),
    ) {
        if out.is_empty() {
            return;
        }
        let count = sides.len() as f32;
        let still = matches!(self.displacement(), Displacement::None);
        for (i, side) in sides.enumerate() {
            evaluate(scratch, side, out.len());
            let Scratch {
                limit, moved, sum, ..
            } = scratch;
            if i == 0 {
                for (k, out) in out.iter_mut().enumerate() {
                    *out = limit.position(k);
                }
                if still {
                    return;
                }
                sum.clear();
                sum.extend_from_slice(moved);
            } else {
                for (sum, moved) in sum.iter_mut().zip(moved) {
                    *sum += *moved;
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(&scratch.sum) {
            *out += *sum / count;
        }
    }

    /// The displaced points at all pairs of the scratch's `us` and `vs`, u running faster, written to rows of `out`
    /// that start `stride` apart.
    pub(super) fn displaced_grid(
        &self,
        face: u32,
        key: u32,
        scratch: &mut Scratch,
        stride: usize,
        out: &mut [Vec3],
    ) {
        let width = scratch.us.len();
        if width == 0 || scratch.vs.is_empty() {
            return;
        }
        self.displace_grid(face, key, scratch);
        let still = matches!(self.displacement(), Displacement::None);
        let [x, y, z] = &scratch.limit.position;
        for (row, out) in out.chunks_mut(stride).take(scratch.vs.len()).enumerate() {
            let here = row * width..(row + 1) * width;
            let limit = x[here.clone()]
                .iter()
                .zip(&y[here.clone()])
                .zip(&z[here.clone()]);
            if still {
                for (out, ((&x, &y), &z)) in out.iter_mut().zip(limit) {
                    *out = Vec3::new(x, y, z);
                }
            } else {
                for ((out, ((&x, &y), &z)), moved) in
                    out.iter_mut().zip(limit).zip(&scratch.moved[here])
                {
                    *out = Vec3::new(x, y, z) + *moved;
                }
            }
        }
    }

    /// The displaced points within a segmented line of constant u or v: `segments + 1` of them, for measuring.
    pub(super) fn inner_line<'a>(
        &self,
        face: u32,
        along_u: bool,
        segments: u32,
        key: u32,
        scratch: &'a mut Scratch,
    ) -> &'a [Vec3] {
        let (moving, fixed) = if along_u {
            (&mut scratch.us, &mut scratch.vs)
        } else {
            (&mut scratch.vs, &mut scratch.us)
        };
        moving.clear();
        moving.extend((0..segments + 1).map(|i| i as f32 / segments as f32));
        fixed.clear();
        fixed.push(0.5);
        self.displace_grid(face, key, scratch);
        scratch.line.clear();
        for i in 0..scratch.limit.len() {
            let moved = scratch.moved.get(i).copied().unwrap_or(Vec3::ZERO);
            scratch.line.push(scratch.limit.position(i) + moved);
        }
        &scratch.line
    }

    /// Limit points and displacements at all pairs of the scratch's `us` and `vs`. Without displacement there are no
    /// displacements either.
    fn displace_grid(&self, face: u32, key: u32, scratch: &mut Scratch) {
        self.base()
            .evaluate_grid(face, &scratch.us, &scratch.vs, key, &mut scratch.limit);
        let (amount, space) = match self.displacement() {
            Displacement::None => {
                scratch.moved.clear();
                return;
            }
            Displacement::Scalar(amount) => (amount, None),
            Displacement::Vector(amount, space) => (amount, Some(*space)),
        };
        unit_normals(&scratch.limit, self.front, &mut scratch.normal);
        self.settle_degenerate(face, key, scratch, space != Some(Space::Object));
        let Scratch {
            us, vs, texcoords, ..
        } = scratch;
        let slopes = space == Some(Space::Tangent);
        let base = self.base();
        if !(self.has_texcoords() && base.texcoord_grid(face, us, vs, slopes, texcoords)) {
            texcoords.clear();
            for &v in vs.iter() {
                for &u in us.iter() {
                    texcoords.push(&Texcoord::of_parameters(Vec2::new(u, v)), slopes);
                }
            }
        }
        self.displacements(face, key, amount, space, scratch);
    }

    /// Gives normals to the points that the first derivatives left without one.
    fn settle_degenerate(&self, face: u32, key: u32, scratch: &mut Scratch, counts: bool) {
        let [x, y, z] = &mut scratch.normal;
        let width = scratch.us.len();
        for i in 0..x.len() {
            if x[i] != 0.0 || y[i] != 0.0 || z[i] != 0.0 {
                continue;
            }
            let uv = Vec2::new(scratch.us[i % width], scratch.vs[i / width]);
            match unit_normal(&self.base().evaluate(face, uv, key), uv, self.front) {
                Some(normal) => [x[i], y[i], z[i]] = normal.to_array(),
                None if counts => self.count_degenerate(1),
                None => {}
            }
        }
    }

    fn displacements(
        &self,
        face: u32,
        key: u32,
        amount: &Amount,
        space: Option<Space>,
        scratch: &mut Scratch,
    ) {
        let Scratch {
            us,
            vs,
            limit,
            normal: [x, y, z],
            texcoords: TexcoordGrid { st, du, dv, .. },
            moved,
            ..
        } = scratch;
        // First the map's values, then what they mean.
        let uv = |i: usize| Vec2::new(us[i % us.len()], vs[i / us.len()]);
        let grid = MapGrid { face, us, vs, st };
        if !amount.map.values(&grid, moved) {
            moved.clear();
            moved.extend((0..limit.len()).map(|i| {
                amount.map.value(&DisplacementPoint {
                    face,
                    uv: uv(i),
                    key,
                    position: limit.position(i),
                    normal: Vec3::new(x[i], y[i], z[i]),
                    st: st[i],
                })
            }));
        }
        let mut non_finite = 0;
        for (i, moved) in moved.iter_mut().enumerate() {
            let normal = Vec3::new(x[i], y[i], z[i]);
            let d = amount.of(*moved);
            let d = match space {
                None => d.x * normal,
                Some(Space::Object) => d,
                Some(Space::Tangent) => {
                    let [pu, pv] = limit.derivatives(i);
                    let frame = Tangents::new([pu, pv], normal, self.front, [du[i], dv[i]]);
                    d.x * frame.t + d.y * frame.b + d.z * normal
                }
            };
            let finite = (limit.position(i) + d).is_finite();
            non_finite += u64::from(!finite);
            *moved = if finite { d } else { Vec3::ZERO };
        }
        if non_finite > 0 {
            self.count_non_finite(non_finite);
        }
    }
}

/// Unit normals to the front; zero where the derivatives are parallel or vanish.
fn unit_normals(limit: &LimitGrid, front: f32, out: &mut [Vec<f32>; 3]) {
    const SQUARED_SINE: f32 = (SINE * SINE) as f32;
    let n = limit.len();
    for axis in out.iter_mut() {
        axis.resize(n, 0.0);
    }
    let [ax, ay, az] = limit.du.each_ref().map(|values| &values[..n]);
    let [bx, by, bz] = limit.dv.each_ref().map(|values| &values[..n]);
    let [ox, oy, oz] = out.each_mut().map(|values| &mut values[..n]);
    for i in 0..n {
        let x = ay[i] * bz[i] - az[i] * by[i];
        let y = az[i] * bx[i] - ax[i] * bz[i];
        let z = ax[i] * by[i] - ay[i] * bx[i];
        let squared = x * x + y * y + z * z;
        let a = ax[i] * ax[i] + ay[i] * ay[i] + az[i] * az[i];
        let b = bx[i] * bx[i] + by[i] * by[i] + bz[i] * bz[i];
        // Products beyond the range of floats are left to the careful way, too.
        let good = squared > SQUARED_SINE * (a * b)
            && (f32::MIN_POSITIVE..f32::INFINITY).contains(&squared);
        let scale = if good { front / squared.sqrt() } else { 0.0 };
        ox[i] = x * scale;
        oy[i] = y * scale;
        oz[i] = z * scale;
    }
}
