//! A NURBS patch as a [`Base`]: its Bezier pieces are the faces, what its trim curves cut away is not seen.
//!
//! Points are evaluated in double precision and rounded once. A rectangle of a piece is bounded by the Bezier points
//! of that part alone: blossoms of the homogeneous points, whose weights are above 0, so that their places span a
//! convex hull of it. A piece of degree three and less whose weights are equal is a bicubic patch.

use super::Bicubic;
use super::base::{Base, Carrier, EdgeUse, LimitPoint, Texcoord, UvRect};
use super::carried::{Carried, Slots, Varying};
use crate::error::Fault;
use crate::math::{Bounds3, DVec3, Vec2, Vec3};
use crate::mesh::{Interpolation, NurbsDirection, NurbsPatch, Primvar};
use crate::nurbs::{BezierFaces, Cover, NurbsSurface, SurfacePoint, Trim};

/// A NURBS patch, perhaps trimmed.
pub struct Patch {
    faces: BezierFaces,
    trim: Trim,
    left_handed: bool,
    /// Faces of which nothing is kept.
    holes: Vec<bool>,
    collapsed: Vec<[bool; 4]>,
    primvars: Slots<Followed>,
    texcoords: Option<usize>,
}

/// A primvar that varies within a patch's faces, and its width.
enum Followed {
    /// Bilinear between the four corners of each face, width values each: (0, 0), (1, 0), (0, 1), (1, 1).
    Corners(usize, Vec<[Vec<f32>; 4]>),
    /// As the points: three components at a time are points of a patch of the same knots and weights.
    Points(usize, Vec<BezierFaces>),
}

impl Patch {
    /// The surface of a patch with those of its primvars that are named; `texcoords` names the one that texture
    /// coordinates are. A patch without a primvar `st` has its parameters over their ranges under that name.
    ///
    /// # Errors
    /// A patch that is not valid, or too large to hold.
    pub fn new(patch: &NurbsPatch, names: &[&str], texcoords: Option<&str>) -> Result<Self, Fault> {
        let faces = BezierFaces::new(&NurbsSurface::new(patch)?)?;
        let trim = Trim::new(patch);
        let is_hole = |face: usize| {
            let [[u0, u1], [v0, v1]] = faces.parameters(face);
            !trim.is_empty() && trim.cover([u0, v0], [u1, v1]) == Cover::Outside
        };
        let mut primvars = Vec::new();
        for &name in names {
            match patch.primvar(name) {
                Some(primvar) => {
                    primvars.push((name.to_owned(), carried(patch, &faces, primvar)?));
                }
                None if name == "st" => {
                    primvars.push((name.to_owned(), Carried::Varying(parameters(patch, &faces))));
                }
                None => {}
            }
        }
        let primvars = Slots::new(primvars);
        Ok(Self {
            holes: (0..faces.face_count()).map(is_hole).collect(),
            collapsed: (0..faces.face_count())
                .map(|f| collapsed(&faces, f))
                .collect(),
            texcoords: primvars.texcoords(texcoords),
            primvars,
            left_handed: patch.left_handed,
            trim,
            faces,
        })
    }

    /// The pieces.
    pub fn pieces(&self) -> &BezierFaces {
        &self.faces
    }

    /// The trim curves.
    pub fn trim(&self) -> &Trim {
        &self.trim
    }

    fn texcoord_at(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord> {
        match self.primvars.varying(slot)? {
            Followed::Corners(width, corners) if *width >= 2 => {
                let [a, b, c, d] = [0, 1, 2, 3].map(|k| {
                    let value = &corners[face as usize][k];
                    Vec2::new(value[0], value[1])
                });
                let twist = d - c - b + a;
                Some(Texcoord {
                    st: (a.lerp(b, uv.x)).lerp(c.lerp(d, uv.x), uv.y),
                    du: b - a + uv.y * twist,
                    dv: c - a + uv.x * twist,
                    duv: twist,
                    ..Texcoord::default()
                })
            }
            Followed::Points(width, fields) if *width >= 2 => {
                let p = limit_point(&fields[0].evaluate(face as usize, pair(uv)));
                let [st, du, dv, duu, duv, dvv] =
                    [p.position, p.du, p.dv, p.duu, p.duv, p.dvv].map(Vec3::truncate);
                Some(Texcoord {
                    st,
                    du,
                    dv,
                    duu,
                    duv,
                    dvv,
                })
            }
            _ => None,
        }
    }
}

impl Base for Patch {
    fn faces(&self) -> u32 {
        self.faces.face_count() as u32
    }

    fn keys(&self) -> u32 {
        self.faces.key_count() as u32
    }

    fn is_hole(&self, face: u32) -> bool {
        self.holes[face as usize]
    }

    fn left_handed(&self) -> bool {
        self.left_handed
    }

    fn is_trimmed(&self) -> bool {
        !self.trim.is_empty()
    }

    fn is_kept(&self, face: u32, uv: Vec2) -> bool {
        let [[u0, u1], [v0, v1]] = self.faces.parameters(face as usize);
        let [u, v] = pair(uv);
        self.trim
            .is_inside([u0 + u * (u1 - u0), v0 + v * (v1 - v0)])
    }

    fn edge(&self, face: u32, k: u32) -> EdgeUse {
        let used = self.faces.edge(face as usize, k as usize);
        EdgeUse {
            edge: used.edge,
            reversed: used.reversed,
        }
    }

    fn vertex(&self, face: u32, k: u32) -> u32 {
        self.faces.vertex(face as usize, k as usize)
    }

    fn is_collapsed(&self, face: u32, k: u32) -> bool {
        self.collapsed[face as usize][k as usize]
    }

    fn evaluate(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint {
        limit_point(
            &self
                .faces
                .evaluate_at_key(key as usize, face as usize, pair(uv)),
        )
    }

    fn hull(&self, face: u32, rect: &UvRect, key: u32) -> Bounds3 {
        let points = self
            .faces
            .part(key as usize, face as usize, pair(rect.min), pair(rect.max));
        rounded(points.iter().map(|p| p.truncate() / p.w))
    }

    fn bezier(&self, face: u32, rect: &UvRect, key: u32) -> Option<Bicubic> {
        let orders = self.faces.orders();
        let points = self
            .faces
            .part(key as usize, face as usize, pair(rect.min), pair(rect.max));
        let w = points[0].w;
        let polynomial = points.iter().all(|p| (p.w - w).abs() <= 1e-12 * w);
        (polynomial && orders[0].max(orders[1]) <= 4).then(|| {
            let places: Vec<DVec3> = points.iter().map(|p| p.truncate() / p.w).collect();
            Bicubic(elevated(&places, orders).map(|p| p.as_vec3()))
        })
    }

    fn texcoord(&self, face: u32, uv: Vec2) -> Option<Texcoord> {
        self.texcoord_at(self.texcoords?, face, uv)
    }

    fn texcoord_hull(&self, face: u32, rect: &UvRect) -> Option<UvRect> {
        let slot = self.texcoords?;
        let bounds = match self.primvars.varying(slot)? {
            Followed::Points(_, fields) => {
                let (min, max) = (pair(rect.min), pair(rect.max));
                let points = fields[0].part(0, face as usize, min, max);
                rounded(points.iter().map(|p| p.truncate() / p.w))
            }
            Followed::Corners(_, values) => {
                // Bilinear: its extremes are in the corners; a few roundings aside.
                let corners = [
                    rect.min,
                    Vec2::new(rect.max.x, rect.min.y),
                    rect.max,
                    Vec2::new(rect.min.x, rect.max.y),
                ]
                .map(|uv| self.texcoord_at(slot, face, uv).map(|t| t.st.extend(0.0)));
                let bounds = Bounds3::of(corners.into_iter().flatten());
                let values = values[face as usize].iter().flatten();
                let largest = values.fold(0.0_f32, |most, x| most.max(x.abs()));
                let slack = Vec3::splat(8.0 * f32::EPSILON * largest);
                Bounds3 {
                    min: bounds.min - slack,
                    max: bounds.max + slack,
                }
            }
        };
        Some(UvRect {
            min: bounds.min.truncate(),
            max: bounds.max.truncate(),
        })
    }

    fn memory(&self) -> usize {
        self.faces.memory()
            + self.holes.len()
            + size_of_val(self.collapsed.as_slice())
            + self.primvars.memory()
    }
}

impl Carrier for Patch {
    fn parent(&self, face: u32) -> u32 {
        face
    }

    fn slot(&self, name: &str, width: usize) -> Option<usize> {
        self.primvars.slot(name, width)
    }

    fn is_texcoord(&self, slot: usize) -> bool {
        self.texcoords == Some(slot)
    }

    fn primvar(&self, slot: usize, face: u32, uv: Vec2, out: &mut [f32]) {
        match self.primvars.get(slot, face, out) {
            None => {}
            Some(Followed::Corners(_, corners)) => {
                let [a, b, c, d] = &corners[face as usize];
                for (i, out) in out.iter_mut().enumerate() {
                    let low = a[i] + uv.x * (b[i] - a[i]);
                    let high = c[i] + uv.x * (d[i] - c[i]);
                    *out = low + uv.y * (high - low);
                }
            }
            Some(Followed::Points(_, fields)) => {
                for (out, field) in out.chunks_mut(3).zip(fields) {
                    let value = field.evaluate(face as usize, pair(uv)).position.as_vec3();
                    out.copy_from_slice(&value.to_array()[..out.len()]);
                }
            }
        }
    }

    fn primvar_slopes(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord> {
        self.texcoord_at(slot, face, uv)
    }
}

/// A primvar of a patch on its faces.
fn carried(
    patch: &NurbsPatch,
    faces: &BezierFaces,
    primvar: &Primvar,
) -> Result<Carried<Followed>, Fault> {
    let width = primvar.width as usize;
    let segments = patch.segments();
    let pieces = [&patch.u, &patch.v].map(|direction| {
        let first = direction.degree();
        let spans = direction.spans().map(|(span, _)| span - first);
        spans.collect::<Vec<_>>()
    });
    let columns = faces.pieces()[0];
    let segment = |face: usize| [pieces[0][face % columns], pieces[1][face / columns]];
    let all = 0..faces.face_count();
    Ok(match primvar.interpolation {
        Interpolation::Constant | Interpolation::FaceVarying => {
            Carried::Constant(primvar.get(0).to_vec())
        }
        Interpolation::Uniform => {
            let value = |face| {
                let [i, j] = segment(face);
                primvar.get(j * segments[0] + i)
            };
            Carried::uniform(width, all.map(value))
        }
        Interpolation::Varying => {
            let corners = |face| {
                let [i, j] = segment(face);
                [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| {
                    let corner = (j + y) * (segments[0] + 1) + i + x;
                    primvar.get(corner).to_vec()
                })
            };
            Carried::Varying(Followed::Corners(width, all.map(corners).collect()))
        }
        Interpolation::Vertex => {
            let three = |first: usize| -> Result<BezierFaces, Fault> {
                let point = |i: usize| {
                    let value = primvar.get(i);
                    let component = |k: usize| value.get(first + k).copied().unwrap_or(0.0);
                    Vec3::new(component(0), component(1), component(2))
                };
                let field = NurbsPatch {
                    points: vec![(0..patch.point_count()).map(point).collect()],
                    trims: Vec::new(),
                    primvars: Vec::new(),
                    ..patch.clone()
                };
                BezierFaces::new(&NurbsSurface::new(&field)?)
            };
            let fields: Result<Vec<_>, Fault> = (0..width).step_by(3).map(three).collect();
            Carried::Varying(Followed::Points(width, fields?))
        }
    })
}

/// The patch's parameters over their ranges.
fn parameters(patch: &NurbsPatch, faces: &BezierFaces) -> Followed {
    let domains = [&patch.u, &patch.v].map(NurbsDirection::domain);
    let corners = |face| {
        let part = faces.parameters(face);
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|ends: [usize; 2]| {
            let along = |axis: usize| {
                let [low, high] = domains[axis];
                ((part[axis][ends[axis]] - low) / (high - low)) as f32
            };
            vec![along(0), along(1)]
        })
    };
    Followed::Corners(2, (0..faces.face_count()).map(corners).collect())
}

impl Varying for Followed {
    fn width(&self) -> usize {
        match self {
            Self::Corners(width, _) | Self::Points(width, _) => *width,
        }
    }

    fn memory(&self) -> usize {
        match self {
            Self::Corners(width, corners) => corners.len() * 4 * (24 + 4 * width),
            Self::Points(_, fields) => fields.iter().map(BezierFaces::memory).sum(),
        }
    }
}

fn pair(uv: Vec2) -> [f64; 2] {
    [f64::from(uv.x), f64::from(uv.y)]
}

fn limit_point(p: &SurfacePoint) -> LimitPoint {
    LimitPoint {
        position: p.position.as_vec3(),
        du: p.du.as_vec3(),
        dv: p.dv.as_vec3(),
        duu: p.duu.as_vec3(),
        duv: p.duv.as_vec3(),
        dvv: p.dvv.as_vec3(),
    }
}

/// A box around places, a step of single precision wider: far more than sums in double precision stray.
fn rounded(places: impl Iterator<Item = DVec3>) -> Bounds3 {
    let mut bounds = Bounds3::EMPTY;
    for place in places {
        let p = place.as_vec3();
        bounds.min = bounds.min.min(Vec3::from(p.to_array().map(f32::next_down)));
        bounds.max = bounds.max.max(Vec3::from(p.to_array().map(f32::next_up)));
    }
    bounds
}

/// The same polynomial patch with four points along each side.
fn elevated(points: &[DVec3], [columns, rows]: [usize; 2]) -> [DVec3; 16] {
    // One degree more: point i of n is a blend of points i - 1 and i.
    let line = |mut line: Vec<DVec3>| {
        while line.len() < 4 {
            let n = line.len();
            let at = |i: usize| {
                let t = i as f64 / n as f64;
                let before = if i > 0 { line[i - 1] } else { line[0] };
                let after = if i < n { line[i] } else { line[n - 1] };
                t * before + (1.0 - t) * after
            };
            line = (0..=n).map(at).collect();
        }
        line
    };
    let wide: Vec<Vec<DVec3>> = (0..rows)
        .map(|r| line(points[r * columns..(r + 1) * columns].to_vec()))
        .collect();
    let tall: Vec<Vec<DVec3>> = (0..4)
        .map(|c| line(wide.iter().map(|row| row[c]).collect()))
        .collect();
    std::array::from_fn(|i| tall[i % 4][i / 4])
}

/// Which edges of a face are but a point, at all motion keys.
fn collapsed(faces: &BezierFaces, face: usize) -> [bool; 4] {
    let [columns, rows] = faces.orders();
    [0, 1, 2, 3].map(|k| {
        let on_edge = |i: usize| {
            let (c, r) = (i % columns, i / columns);
            match k {
                0 => r == 0,
                1 => c == columns - 1,
                2 => r == rows - 1,
                _ => c == 0,
            }
        };
        faces.vertex(face, k) == faces.vertex(face, (k + 1) % 4)
            && (0..faces.key_count()).all(|key| {
                let all: Vec<DVec3> = faces.hull(key, face).collect();
                let edge: Vec<DVec3> = (0..all.len())
                    .filter(|&i| on_edge(i))
                    .map(|i| all[i])
                    .collect();
                let size = all.iter().map(|p| p.distance(all[0])).fold(0.0, f64::max);
                // Such edges were brought to one place; dividing by weights again rounds.
                let largest = all
                    .iter()
                    .map(|p| p.abs().max_element())
                    .fold(0.0, f64::max);
                edge.iter()
                    .all(|p| p.distance(edge[0]) <= 1e-12 * (size + largest))
            })
    })
}
