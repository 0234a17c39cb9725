//! The limit surface of any face, alone: position and derivatives at (face, u, v), with creases, in the manner of
//! Nießner et al., *Feature-Adaptive GPU Rendering of Catmull-Clark Subdivision Surfaces*, 2012: regular faces are
//! polynomial patches, others are split around what makes them irregular.
//!
//! Nothing global is refined. Each face has the numbers of its ring's vertices, a plan that it shares with all faces
//! in equal surroundings, and the few points that the plan makes. Unlike the paper there are no approximating patches
//! where refinement stops: the last splits are repeated while evaluating, down to the limit itself.
//!
//! Faces here are *Ptex faces*: with Catmull-Clark and bilinear meshes a quad is one, any other face one for each of
//! its corners; with Loop a triangle is one.
//!
//! ```text
//!   3 ---- 2     quad: (0, 0) is corner 0, (1, 0) corner 1, (0, 1) corner 3
//!   |      |     sub-face k: (0, 0) is corner k of its face, (1, 0) the middle of the edge to the next corner,
//!   0 ---- 1       (1, 1) the middle of the face
//!                triangle: (0, 0), (1, 0), (0, 1) are its corners
//! ```

mod build;
mod leaves;

use rayon::prelude::*;

use super::cage::Cage;
use super::descent::{Found, descend_strip, pick, run, weigh};
use super::parameters::{by_parameters, clamp, corner_at, quarter};
use super::patch::{self, FirstOrder, LimitPoint, PatchKind, Real};
use super::plan::{Node, Plan, STORED_SPLITS};
use super::step::{Descent, Shape, Steps};
use crate::mesh::{ControlMesh, FaceVaryingInterpolation, Primvar};

pub use leaves::BezierLeaf;

/// The limit surface of a control mesh, without its points: see [`LimitSurface::field`].
#[derive(Debug)]
pub struct LimitSurface {
    kind: PatchKind,
    faces: Vec<Face>,
    /// The vertices of the rings, one after the other.
    rings: Vec<u32>,
    plans: Vec<Plan>,
    steps: Steps,
    vertices: usize,
    /// Points that all faces have of their own.
    own_points: usize,
    /// The first Ptex face of each face of the mesh, and how many there are.
    first_ptex: Vec<u32>,
}

/// A Ptex face.
#[derive(Debug, Clone, Copy)]
struct Face {
    /// [`HOLE`] where there is no surface.
    plan: u32,
    ring: u32,
    own: u32,
}

const HOLE: u32 = u32::MAX;

/// What follows a surface: the points, or a primvar, carried to all patches.
#[derive(Debug, Clone)]
pub struct Field<T> {
    width: usize,
    /// The vertices' values, then those of the faces' own points, and one number more: points are read by fours.
    values: Vec<T>,
}

impl<T> Field<T> {
    /// Components of a value.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

impl LimitSurface {
    /// The limit surface of a valid mesh. Polygon meshes count as bilinear.
    pub fn new(mesh: &ControlMesh) -> Self {
        Self::of(&Cage::of(mesh))
    }

    /// The surface over which a face-varying primvar of a valid mesh is smooth, and the primvar's element at each
    /// of its vertices: [`field`](Self::field) takes the elements in this order.
    pub fn face_varying(
        mesh: &ControlMesh,
        primvar: &Primvar,
        rule: FaceVaryingInterpolation,
    ) -> (Self, Vec<u32>) {
        let (cage, elements) = Cage::of(mesh).cut(primvar, rule);
        (Self::of(&cage), elements)
    }

    /// How many Ptex faces there are, holes included.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// How many vertices the control mesh has.
    pub fn vertex_count(&self) -> usize {
        self.vertices
    }

    /// The Ptex faces of a face of the mesh.
    pub fn ptex_faces(&self, face: u32) -> std::ops::Range<u32> {
        self.first_ptex[face as usize]..self.first_ptex[face as usize + 1]
    }

    /// Whether parameters run over a triangle, u + v ≤ 1, instead of a square.
    pub fn is_triangular(&self) -> bool {
        self.kind.is_triangular()
    }

    /// Whether there is no surface: a hole, or a face at a border that is left out.
    pub fn is_hole(&self, face: u32) -> bool {
        self.faces[face as usize].plan == HOLE
    }

    /// Carries values of `width` components, one after the other for each vertex, to the points of all patches.
    ///
    /// # Panics
    /// If `values` are not as many as the vertices ask for.
    pub fn field<T: Real>(&self, mut values: Vec<T>, width: usize) -> Field<T> {
        assert_eq!(
            values.len(),
            self.vertices * width,
            "values of all vertices"
        );
        values.reserve_exact(self.own_points * width + 1);
        values.resize((self.vertices + self.own_points) * width + 1, T::default());
        // Faces own consecutive stretches, so each can be filled by itself.
        let (vertices, mut rest) = values.split_at_mut(self.vertices * width);
        let vertices = &*vertices;
        let mut work = Vec::new();
        for face in self.faces.iter().filter(|f| f.plan != HOLE) {
            let rows = self.plans[face.plan as usize].program.len();
            if rows > 0 {
                let (stretch, after) = rest.split_at_mut(rows * width);
                work.push((*face, stretch));
                rest = after;
            }
        }
        work.into_par_iter()
            .with_min_len(16)
            .for_each(|(face, out)| {
                let plan = &self.plans[face.plan as usize];
                let ring = &self.rings[face.ring as usize..][..plan.ring as usize];
                let mut points: Vec<f64> =
                    Vec::with_capacity((ring.len() + plan.program.len()) * width);
                for &vertex in ring {
                    points.extend(
                        vertices[vertex as usize * width..][..width]
                            .iter()
                            .map(|x| x.get()),
                    );
                }
                run(&plan.program, width, &mut points);
                for (out, &x) in out.iter_mut().zip(&points[ring.len() * width..]) {
                    *out = T::of(x);
                }
            });
        Field { width, values }
    }

    /// The field of a mesh's points at a motion key.
    pub fn points<T: Real>(&self, mesh: &ControlMesh, key: usize) -> Field<T> {
        let points = mesh.points[key].iter().flat_map(|p| p.to_array());
        self.field(points.map(|x| T::of(f64::from(x))).collect(), 3)
    }

    /// The point at (u, v) on a Ptex face, with its derivatives by u and v. `field` has three components.
    ///
    /// Exactly at an extraordinary vertex derivatives have no length: du × dv is then along the normal, and both are
    /// of the order of the face's size; second derivatives are 0.
    ///
    /// Parameters outside of the face are moved to its border.
    ///
    /// # Panics
    /// If the face is a hole, or the field is not of three components.
    pub fn evaluate<T: Real>(&self, field: &Field<T>, face: u32, u: f64, v: f64) -> LimitPoint<T> {
        assert_eq!(field.width, 3);
        let place = self.find(face, u, v);
        match place.part {
            Part::Patch => {
                let point = |i| place.lanes(field, i);
                patch::second_order(self.kind, point, [place.u, place.v], place.scale)
            }
            Part::Split(step) => self.split(field, &place, step),
        }
    }

    /// As [`evaluate`](Self::evaluate) without second derivatives, and faster.
    ///
    /// # Panics
    /// If the face is a hole, or the field is not of three components.
    pub fn first_order<T: Real>(
        &self,
        field: &Field<T>,
        face: u32,
        u: f64,
        v: f64,
    ) -> FirstOrder<T> {
        assert_eq!(field.width, 3);
        let place = self.find(face, u, v);
        match place.part {
            Part::Patch => {
                let point = |i| place.lanes(field, i);
                patch::first_order(self.kind, point, [place.u, place.v], place.scale)
            }
            Part::Split(step) => self.split(field, &place, step).into(),
        }
    }

    /// The value of a field of any width at (u, v) on a Ptex face.
    ///
    /// # Panics
    /// If the face is a hole, or `out` is not as long as the field is wide.
    pub fn interpolate<T: Real>(&self, field: &Field<T>, face: u32, u: f64, v: f64, out: &mut [T]) {
        assert_eq!(out.len(), field.width);
        self.sum(field, &self.find(face, u, v), out);
    }

    /// The vertices of which the points at places of a Ptex face are sums, with their weights: for each place, each
    /// vertex once, in order of their numbers.
    ///
    /// # Panics
    /// If the face is a hole.
    pub fn weights(&self, face: u32, places: &[[f64; 2]]) -> Vec<Vec<(u32, f64)>> {
        let whole = self.faces[face as usize];
        assert_ne!(whole.plan, HOLE, "weights of a hole");
        let plan = &self.plans[whole.plan as usize];
        let count = plan.ring as usize;
        // A field of the ring alone, each of its vertices with a component of its own.
        let mut values = vec![0.0; count * count];
        values.iter_mut().step_by(count + 1).for_each(|x| *x = 1.0);
        run(&plan.program, count, &mut values);
        values.push(0.0);
        let field = Field {
            width: count,
            values,
        };
        let numbers: Vec<u32> = (0..plan.ring).collect();
        let ring = &self.rings[whole.ring as usize..][..count];
        let mut sums = vec![0.0; count];
        let row = |[u, v]: &[f64; 2]| {
            let place = Place {
                ring: &numbers,
                own: plan.ring,
                ..self.find(face, *u, *v)
            };
            self.sum(&field, &place, &mut sums);
            let terms = ring.iter().copied().zip(sums.iter().copied());
            let mut row: Vec<(u32, f64)> = terms.filter(|term| term.1 != 0.0).collect();
            row.sort_by_key(|term| term.0);
            row.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                kept.1 += if same { next.1 } else { 0.0 };
                same
            });
            row
        };
        places.iter().map(row).collect()
    }

    fn sum<T: Real>(&self, field: &Field<T>, place: &Place<'_>, out: &mut [T]) {
        let width = field.width;
        let mut sum = vec![0.0; width];
        match place.part {
            Part::Patch => {
                let weights = self.kind.weights(place.u, place.v);
                for (&i, &w) in place.points.iter().zip(&weights[..self.kind.points()]) {
                    for (sum, x) in sum.iter_mut().zip(place.value(field, i)) {
                        *sum += w * x.get();
                    }
                }
            }
            Part::Split(step) => {
                let ring = self.steps.get(step).ring as usize;
                let points = place.points[..ring]
                    .iter()
                    .flat_map(|&i| place.value(field, i).iter().map(|x| x.get()));
                let found = self.descend(step, points.collect(), width, place.u, place.v);
                found.value(self.kind, &mut sum);
            }
        }
        for (out, sum) in out.iter_mut().zip(sum) {
            *out = T::of(sum);
        }
    }

    /// Whether a corner of a Ptex face, (0, 0), (1, 0), (1, 1), (0, 1) or of a triangle (0, 0), (1, 0), (0, 1), is an
    /// extraordinary point: one where derivatives have no length.
    pub fn is_extraordinary(&self, face: u32, u: f64, v: f64) -> bool {
        let place = self.find(face, u, v);
        match place.part {
            Part::Patch => false,
            Part::Split(step) => corner_at(self.kind, place.u, place.v)
                .is_some_and(|c| matches!(self.steps.get(step).limits.get(c), Some(Some(_)))),
        }
    }

    /// The point at an extraordinary corner as OpenSubdiv gives it, which stops at an isolation level: masks over the
    /// points after `level` refinements of the mesh's face, 6 and more. Nothing if the corner is no longer
    /// extraordinary there, or (u, v) is no corner; what [`evaluate`](Self::evaluate) gives is exact then.
    ///
    /// Where this differs from the limit, at darts, corners and the ends of borders, it comes nearer with each level.
    pub fn isolate<T: Real>(
        &self,
        field: &Field<T>,
        face: u32,
        u: f64,
        v: f64,
        level: u32,
    ) -> Option<Isolated> {
        debug_assert!(level > STORED_SPLITS);
        let corner = corner_at(self.kind, u, v)?;
        let place = self.find(face, u, v);
        let Part::Split(step) = place.part else {
            return None;
        };
        let width = field.width;
        let mut size = place.scale[0].abs();
        let ring = self.steps.get(step).ring as usize;
        let mut points: Vec<f64> = place.points[..ring]
            .iter()
            .flat_map(|&i| place.value(field, i).iter().map(|x| x.get()))
            .collect();
        let mut descent = Descent::new(&self.steps, step);
        for _ in place.level..level {
            let split = descent.step();
            run(&split.rows, width, &mut points);
            let Shape::Split { step: next, ring } = &split.children[corner] else {
                return None;
            };
            points = pick(&points, width, ring);
            let next = *next;
            descent.enter(next);
            size *= 2.0;
        }
        let mask = descent.step().masks.get(corner)?.as_ref()?;
        let sum = |row: &[f64]| weigh(row, &points, width);
        let limit = &mask.limit;
        let tangents = [&limit.tangents[0], &limit.tangents[1]]
            .map(|row| sum(row).iter().map(|x| x * size).collect());
        Some(Isolated {
            position: sum(&limit.position),
            tangents: by_parameters(self.kind, corner, tangents),
            has_lengths: mask.has_lengths,
        })
    }

    /// Bytes held, fields not included.
    pub fn memory(&self) -> usize {
        size_of_val(self.faces.as_slice())
            + size_of_val(self.rings.as_slice())
            + size_of_val(self.first_ptex.as_slice())
            + self.plans.iter().map(Plan::memory).sum::<usize>()
            + self.steps.memory()
    }

    /// How many different plans the faces share.
    pub fn plan_count(&self) -> usize {
        self.plans.len()
    }

    /// The part of the face's plan that (u, v) is in.
    #[inline(always)]
    fn find(&self, face: u32, u: f64, v: f64) -> Place<'_> {
        let face = self.faces[face as usize];
        assert_ne!(face.plan, HOLE, "evaluation of a hole");
        let plan = &self.plans[face.plan as usize];
        let [mut u, mut v] = clamp(self.kind, u, v);
        let mut size = [1.0; 2];
        let mut node = 0;
        let mut level = plan.level;
        let (part, points) = loop {
            match plan.nodes[node] {
                Node::Quarters(quarters) => {
                    level += 1;
                    node = quarters[quarter(self.kind, &mut u, &mut v, &mut size)] as usize;
                }
                Node::Halves { edge, halves } => {
                    let (t, size, turned) = match edge {
                        0 => (&mut v, &mut size[1], true),
                        1 => (&mut u, &mut size[0], false),
                        2 => (&mut v, &mut size[1], false),
                        _ => (&mut u, &mut size[0], true),
                    };
                    let near = if turned { 1.0 - *t } else { *t };
                    let half = usize::from(near >= 0.5);
                    let near = 2.0 * near - half as f64;
                    *t = if turned { 1.0 - near } else { near };
                    *size *= 2.0;
                    node = halves[half] as usize;
                }
                Node::Patch(points) => break (Part::Patch, points),
                Node::Split { step, points } => break (Part::Split(step), points),
            }
        };
        Place {
            level,
            part,
            points: &plan.points[points as usize..],
            ring: &self.rings[face.ring as usize..][..plan.ring as usize],
            own: self.vertices as u32 + face.own,
            u,
            v,
            scale: size,
        }
    }

    /// Evaluates by what is left to be split.
    #[cold]
    fn split<T: Real>(&self, field: &Field<T>, place: &Place<'_>, step: u32) -> LimitPoint<T> {
        let ring = self.steps.get(step).ring as usize;
        let points = place.points[..ring]
            .iter()
            .flat_map(|&i| place.value(field, i).iter().map(|x| x.get()));
        let found = self.descend(step, points.collect(), 3, place.u, place.v);
        found.finish(self.kind, place.scale)
    }

    /// Repeats a step until (u, v) lies in a patch. `points` are those of the step's ring.
    fn descend(
        &self,
        step: u32,
        mut points: Vec<f64>,
        width: usize,
        mut u: f64,
        mut v: f64,
    ) -> Found {
        let mut size = [1.0; 2];
        let mut descent = Descent::new(&self.steps, step);
        for splits in 0.. {
            let split = descent.step();
            debug_assert!(splits < 200, "steps that never settle");
            if let Some(corner) = corner_at(self.kind, u, v)
                && let Some(limit) = split.limits.get(corner).and_then(Option::as_ref)
            {
                let sum = |row: &[f64]| weigh(row, &points, width);
                let tangents = [sum(&limit.tangents[0]), sum(&limit.tangents[1])];
                return Found::Corner {
                    position: sum(&limit.position),
                    tangents: by_parameters(self.kind, corner, tangents),
                };
            }
            run(&split.rows, width, &mut points);
            let child = quarter(self.kind, &mut u, &mut v, &mut size);
            let pick = |list: &[u32]| pick(&points, width, list);
            match &split.children[child] {
                Shape::Patch(list) => {
                    return Found::Patch {
                        points: pick(list),
                        width,
                        u,
                        v,
                        size,
                    };
                }
                Shape::Strip {
                    points: list,
                    edge,
                    sharpness,
                } => {
                    let mut line = pick(list);
                    return descend_strip(&mut line, width, *edge, *sharpness, [u, v], size);
                }
                Shape::Split { step: next, ring } => {
                    points = pick(ring);
                    let next = *next;
                    descent.enter(next);
                }
            }
        }
        unreachable!("a split leads to a patch, or to itself at a vertex whose limit is known")
    }
}

/// See [`LimitSurface::isolate`].
#[derive(Debug, Clone)]
pub struct Isolated {
    /// As wide as the field.
    pub position: Vec<f64>,
    /// By u and v, or some way round in the same plane where only directions are known.
    pub tangents: [Vec<f64>; 2],
    /// Whether the tangents are derivatives, and not directions only.
    pub has_lengths: bool,
}

/// Where parameters lie in a plan.
struct Place<'a> {
    /// How often the mesh's face is split here.
    level: u32,
    part: Part,
    points: &'a [u32],
    ring: &'a [u32],
    /// The number of the face's first own point in a field.
    own: u32,
    u: f64,
    v: f64,
    /// What derivatives are to be multiplied with.
    scale: [f64; 2],
}

enum Part {
    Patch,
    Split(u32),
}

impl Place<'_> {
    /// The number of a point of the plan in a field.
    #[inline(always)]
    fn index(&self, point: u32) -> usize {
        // Both are worked out: which of them it is, a processor cannot foresee.
        let vertex = self.ring[(point as usize).min(self.ring.len() - 1)];
        let own = self
            .own
            .wrapping_add(point.wrapping_sub(self.ring.len() as u32));
        let is_own = point as usize >= self.ring.len();
        (if is_own { own } else { vertex }) as usize
    }

    /// Point `i` of a patch.
    #[inline(always)]
    fn lanes<T: Real>(&self, field: &Field<T>, i: usize) -> T::Lanes {
        let values = &field.values[3 * self.index(self.points[i])..];
        T::lanes(
            *values
                .first_chunk()
                .expect("a number more than the points have"),
        )
    }

    fn value<'f, T>(&self, field: &'f Field<T>, point: u32) -> &'f [T] {
        &field.values[self.index(point) * field.width..][..field.width]
    }
}
