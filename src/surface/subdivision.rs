//! A subdivision surface as a [`Base`]: limit points, texture coordinates and certified boxes of a [`LimitSurface`].
//!
//! Faces are Ptex faces, or the [parts](super::parts) of them where a mesh has faces that are not quads;
//! [`Subdivision::on_cage`] goes back. Grids are another file's business ([`grids`](super::grids)).

use super::Bicubic;
use super::base::{Base, Carrier, EdgeUse, LimitGrid, LimitPoint, Texcoord, TexcoordGrid, UvRect};
use super::carried::{Slots, Varying};
use super::parts::{Part, Shape, parts};
use super::rates::Rates;
use super::subdivided::Subdivided;
use crate::math::{Bounds3, Vec2, Vec3};
use crate::mesh::{ControlMesh, Topology};
use crate::subdiv::{Field, LimitSurface};

/// The limit surface of a control mesh.
pub struct Subdivision {
    limit: LimitSurface,
    /// The points at each motion key.
    points: Vec<Field<f32>>,
    /// The largest coordinate of each key.
    largest: Vec<f32>,
    primvars: Slots<Subdivided>,
    /// Which of them is the texture coordinates.
    texcoords: Option<usize>,
    parts: Vec<Part>,
    is_cut: bool,
    /// The face of the mesh that each part is of, if faces are cut.
    parents: Vec<u32>,
    left_handed: bool,
}

/// Evaluations in single precision err by fewer units of 2^-24 of the largest coordinate.
const ROUNDINGS: f32 = 64.0;

impl Subdivision {
    /// The surface of a valid mesh. `texcoords` names a primvar of two components, which a point, a vertex or a
    /// corner has; without one the surface has none.
    pub fn new(mesh: &ControlMesh, texcoords: Option<&str>) -> Self {
        let names: Vec<&str> = texcoords.into_iter().collect();
        Self::carrying(mesh, &names, texcoords)
    }

    /// As [`new`](Self::new), with those of the mesh's primvars that are named.
    pub fn carrying(mesh: &ControlMesh, names: &[&str], texcoords: Option<&str>) -> Self {
        let limit = LimitSurface::new(mesh);
        let topology = mesh.topology();
        let (parts, is_cut) = parts(mesh, &topology, limit.is_triangular());
        let points: Vec<Field<f32>> = (0..mesh.points.len())
            .map(|key| limit.points(mesh, key))
            .collect();
        let given = names.iter().filter_map(|name| mesh.primvar(name));
        let primvars = Slots::new(
            given
                .map(|primvar| {
                    let carried = Subdivided::carried(mesh, &topology, &limit, primvar);
                    (primvar.name.clone(), carried)
                })
                .collect(),
        );
        let face_of_part = |face: usize| topology.corners(face as u32).map(move |_| face as u32);
        Self {
            largest: points.iter().map(|field| field.largest() as f32).collect(),
            texcoords: primvars.texcoords(texcoords),
            primvars,
            parents: if is_cut {
                (0..topology.face_count()).flat_map(face_of_part).collect()
            } else {
                Vec::new()
            },
            limit,
            points,
            parts,
            is_cut,
            left_handed: mesh.left_handed,
        }
    }

    /// Whether a face of the cage is one Ptex face with four sides.
    pub fn is_quad(&self, cage_face: u32) -> bool {
        let first = &self.parts[self.first_part(cage_face) as usize];
        !self.is_cut || matches!(first.shape, Shape::Quarter(_))
    }

    /// Where a point of a face is on the cage: the cage's face, the corner at which its sub-face lies if it is no quad,
    /// and the Ptex parameters there.
    pub fn on_cage(&self, face: u32, uv: Vec2) -> (u32, Option<u32>, Vec2) {
        let part = &self.parts[face as usize];
        let parent = self.parent(face);
        let is_sub_face = self.is_cut && part.shape == Shape::Whole;
        let corner = is_sub_face.then(|| face - self.first_part(parent));
        (
            parent,
            corner,
            Vec2::from(part.shape.place(uv).uv.map(|x| x as f32)),
        )
    }

    /// The face and the parameters on it of what [`on_cage`](Self::on_cage) gives, for faces that are no triangles of
    /// Loop's.
    pub fn of_cage(&self, cage_face: u32, corner: Option<u32>, uv: Vec2) -> (u32, Vec2) {
        let first = self.first_part(cage_face);
        match corner {
            Some(corner) => (first + corner, uv),
            None if self.is_cut => {
                let (corner, uv) = Shape::quarter_at(uv);
                (first + u32::from(corner), uv)
            }
            None => (first, uv),
        }
    }

    /// Whether it has texture coordinates.
    pub fn has_texcoords(&self) -> bool {
        self.texcoords.is_some()
    }

    /// The texture coordinates at a point of a Ptex face; none where there is no surface.
    pub fn texcoord_on_ptex(&self, ptex: u32, [u, v]: [f64; 2]) -> Option<Vec2> {
        let (limit, st) = self.texcoords()?;
        if limit.is_hole(ptex) {
            return None;
        }
        let value = limit.first_order(&st.field, ptex, u, v).position;
        Some(Vec3::from(value).truncate())
    }

    /// Their derivatives by the parameters of a Ptex face, likewise.
    pub fn texcoord_slopes_on_ptex(&self, ptex: u32, [u, v]: [f64; 2]) -> Option<[Vec2; 2]> {
        let (limit, st) = self.texcoords()?;
        if limit.is_hole(ptex) {
            return None;
        }
        let value = limit.first_order(&st.field, ptex, u, v);
        Some([value.du, value.dv].map(|slope| Vec3::from(slope).truncate()))
    }

    /// The point of the surface, at the first motion key, at a point of a Ptex face; none where there is no surface.
    pub fn position_on_ptex(&self, ptex: u32, [u, v]: [f64; 2]) -> Option<Vec3> {
        let seen = !self.limit.is_hole(ptex);
        seen.then(|| {
            let point = self.limit.first_order(&self.points[0], ptex, u, v);
            Vec3::from(point.position)
        })
    }

    fn first_part(&self, cage_face: u32) -> u32 {
        if self.is_cut {
            self.parents.partition_point(|&parent| parent < cage_face) as u32
        } else {
            cage_face
        }
    }

    /// Whether faces are parts of Ptex faces, so that each edge of the cage is two.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// The segments of the cage's edges at the given rates, for each corner of each face that of the edge which leaves
    /// it.
    pub fn corner_rates(&self, topology: &Topology, rates: &Rates) -> Vec<u32> {
        (0..topology.corner_count() as u32)
            .map(|corner| {
                let edge = topology.edge(corner);
                if self.is_cut {
                    rates.edge(2 * edge) + rates.edge(2 * edge + 1)
                } else {
                    rates.edge(edge)
                }
            })
            .collect()
    }

    /// The texture coordinates and the surface over which they are smooth.
    fn texcoords(&self) -> Option<(&LimitSurface, &Subdivided)> {
        let st = self.primvars.varying(self.texcoords?)?;
        Some((st.limit.as_ref().unwrap_or(&self.limit), st))
    }

    /// The patch that a part of a face lies in, over that part alone, if it is one.
    pub(super) fn patch_of(
        &self,
        limit: &LimitSurface,
        field: &Field<f32>,
        face: u32,
        rect: &UvRect,
    ) -> Option<Bicubic> {
        let part = &self.parts[face as usize];
        let [min, max] = part.shape.place_rect(rect.min, rect.max);
        let leaf = limit.bezier(field, part.ptex, [min, max])?;
        let patch = Bicubic(leaf.points.map(|p| Vec3::from(p.map(|x| x as f32))));
        let within = |x: [f64; 2]| {
            Vec2::from([0, 1].map(|i| ((x[i] - leaf.min[i]) / (leaf.max[i] - leaf.min[i])) as f32))
        };
        let within = UvRect {
            min: within(min),
            max: within(max),
        };
        let patch = if within == UvRect::UNIT {
            patch
        } else {
            patch.restricted(&within)
        };
        Some(match part.shape {
            Shape::Quarter(corner) => turned(&patch, corner),
            _ => patch,
        })
    }

    /// A point without second derivatives.
    pub(super) fn first_order_of(
        &self,
        limit: &LimitSurface,
        field: &Field<f32>,
        face: u32,
        uv: Vec2,
    ) -> LimitPoint {
        let part = &self.parts[face as usize];
        let placed = part.shape.place(uv);
        let [u, v] = placed.uv;
        let p = limit.first_order(field, part.ptex, u, v);
        let slopes = [p.du, p.dv].map(Vec3::from);
        let [du, dv] = match part.shape {
            Shape::Whole => slopes,
            _ => placed.pull_back_slopes(slopes),
        };
        LimitPoint {
            position: p.position.into(),
            du,
            dv,
            ..LimitPoint::default()
        }
    }

    fn limit_point(
        &self,
        limit: &LimitSurface,
        field: &Field<f32>,
        face: u32,
        uv: Vec2,
    ) -> LimitPoint {
        let part = &self.parts[face as usize];
        let placed = part.shape.place(uv);
        let [u, v] = placed.uv;
        let p = limit.evaluate(field, part.ptex, u, v);
        let [position, du, dv, duu, duv, dvv] =
            [p.position, p.du, p.dv, p.duu, p.duv, p.dvv].map(Vec3::from);
        let point = LimitPoint {
            position,
            du,
            dv,
            duu,
            duv,
            dvv,
        };
        match part.shape {
            Shape::Whole => point,
            _ => placed.pull_back(&point),
        }
    }

    fn hull_of(
        &self,
        limit: &LimitSurface,
        field: &Field<f32>,
        largest: f32,
        face: u32,
        rect: &UvRect,
    ) -> Bounds3 {
        let slack = Vec3::splat(ROUNDINGS * 0.5 * f32::EPSILON * largest + f32::MIN_POSITIVE);
        let bounds = match self.patch_of(limit, field, face, rect) {
            Some(patch) => Bounds3::of(patch.0),
            None => {
                let part = &self.parts[face as usize];
                let [min, max] = part.shape.place_rect(rect.min, rect.max);
                let mut bounds = Bounds3::EMPTY;
                limit.hull_points(field, part.ptex, [min, max], |p| {
                    bounds = bounds.including(Vec3::from(p));
                });
                bounds
            }
        };
        Bounds3 {
            min: bounds.min - slack,
            max: bounds.max + slack,
        }
    }
}

/// A quarter's patch, given in the directions of its quad, as seen from the quad's corner that it is at.
fn turned(patch: &Bicubic, corner: u8) -> Bicubic {
    Bicubic(std::array::from_fn(|i| {
        let (c, r) = (i % 4, i / 4);
        let (c, r) = match corner {
            0 => (c, r),
            1 => (3 - r, c),
            2 => (3 - c, 3 - r),
            _ => (r, 3 - c),
        };
        patch.0[4 * r + c]
    }))
}

impl Base for Subdivision {
    fn faces(&self) -> u32 {
        self.parts.len() as u32
    }

    fn keys(&self) -> u32 {
        self.points.len() as u32
    }

    fn is_hole(&self, face: u32) -> bool {
        self.limit.is_hole(self.parts[face as usize].ptex)
    }

    fn left_handed(&self) -> bool {
        self.left_handed
    }

    fn edge(&self, face: u32, k: u32) -> EdgeUse {
        self.parts[face as usize].edge(k)
    }

    fn vertex(&self, face: u32, k: u32) -> u32 {
        self.parts[face as usize].vertices[k as usize]
    }

    fn evaluate(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint {
        self.limit_point(&self.limit, &self.points[key as usize], face, uv)
    }

    fn first_order(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint {
        if self.is_hole(face) {
            return LimitPoint::default();
        }
        self.first_order_of(&self.limit, &self.points[key as usize], face, uv)
    }

    fn evaluate_grid(&self, face: u32, us: &[f32], vs: &[f32], key: u32, out: &mut LimitGrid) {
        let points = &self.points[key as usize];
        self.grid::<true>((&self.limit, points), face, [us, vs], out);
    }

    fn hull(&self, face: u32, rect: &UvRect, key: u32) -> Bounds3 {
        let key = key as usize;
        self.hull_of(
            &self.limit,
            &self.points[key],
            self.largest[key],
            face,
            rect,
        )
    }

    fn bezier(&self, face: u32, rect: &UvRect, key: u32) -> Option<Bicubic> {
        self.patch_of(&self.limit, &self.points[key as usize], face, rect)
    }

    fn texcoord(&self, face: u32, uv: Vec2) -> Option<Texcoord> {
        self.primvar_slopes(self.texcoords?, face, uv)
    }

    fn texcoord_grid(
        &self,
        face: u32,
        us: &[f32],
        vs: &[f32],
        slopes: bool,
        out: &mut TexcoordGrid,
    ) -> bool {
        out.clear();
        let Some((limit, st)) = self.texcoords() else {
            return false;
        };
        let (of, grid) = ((limit, &st.field), &mut out.room);
        if slopes {
            self.grid::<true>(of, face, [us, vs], grid);
        } else {
            self.grid::<false>(of, face, [us, vs], grid);
        }
        let two = |[x, y, _]: &[Vec<f32>; 3], out: &mut Vec<Vec2>| {
            out.extend(x.iter().zip(y).map(|(&x, &y)| Vec2::new(x, y)));
        };
        two(&grid.position, &mut out.st);
        if slopes {
            two(&grid.du, &mut out.du);
            two(&grid.dv, &mut out.dv);
        }
        true
    }

    fn texcoord_hull(&self, face: u32, rect: &UvRect) -> Option<UvRect> {
        let (limit, st) = self.texcoords()?;
        let bounds = self.hull_of(limit, &st.field, st.largest, face, rect);
        Some(UvRect {
            min: bounds.min.truncate(),
            max: bounds.max.truncate(),
        })
    }

    fn memory(&self) -> usize {
        self.limit.memory()
            + self.points.iter().map(Field::memory).sum::<usize>()
            + self.primvars.memory()
            + size_of_val(self.parts.as_slice())
            + size_of_val(self.parents.as_slice())
    }
}

impl Carrier for Subdivision {
    fn parent(&self, face: u32) -> u32 {
        if self.is_cut {
            self.parents[face as usize]
        } else {
            face
        }
    }

    fn ptex(&self, face: u32, uv: Vec2) -> Option<(u32, Vec2)> {
        let part = &self.parts[face as usize];
        let [u, v] = part.shape.place(uv).uv;
        Some((part.ptex, Vec2::new(u as f32, v as f32)))
    }

    fn ptex_slopes(&self, face: u32, uv: Vec2) -> [Vec2; 2] {
        let placed = self.parts[face as usize].shape.place(uv);
        [placed.du, placed.dv].map(|d| Vec2::new(d[0] as f32, d[1] as f32))
    }

    fn slot(&self, name: &str, width: usize) -> Option<usize> {
        self.primvars.slot(name, width)
    }

    fn is_texcoord(&self, slot: usize) -> bool {
        self.texcoords == Some(slot)
    }

    fn primvar(&self, slot: usize, face: u32, uv: Vec2, out: &mut [f32]) {
        let Some(varying) = self.primvars.get(slot, self.parent(face), out) else {
            return;
        };
        let limit = varying.limit.as_ref().unwrap_or(&self.limit);
        let part = &self.parts[face as usize];
        let [u, v] = part.shape.place(uv).uv;
        if varying.width() <= 3 {
            let value = limit.first_order(&varying.field, part.ptex, u, v).position;
            out.copy_from_slice(&value[..out.len()]);
        } else {
            let mut value = vec![0.0; varying.width()];
            limit.interpolate(&varying.field, part.ptex, u, v, &mut value);
            out.copy_from_slice(&value[..out.len()]);
        }
    }

    fn primvar_slopes(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord> {
        let varying = self.primvars.varying(slot)?;
        if !(2..=3).contains(&varying.width()) {
            return None;
        }
        if self.is_hole(face) {
            return Some(Texcoord::default());
        }
        let limit = varying.limit.as_ref().unwrap_or(&self.limit);
        let p = self.limit_point(limit, &varying.field, face, uv);
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

    fn primvar_first_slopes(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord> {
        let varying = self.primvars.varying(slot)?;
        if !(2..=3).contains(&varying.width()) {
            return None;
        }
        let limit = varying.limit.as_ref().unwrap_or(&self.limit);
        let p = self.first_order_of(limit, &varying.field, face, uv);
        Some(Texcoord {
            st: p.position.truncate(),
            du: p.du.truncate(),
            dv: p.dv.truncate(),
            ..Texcoord::default()
        })
    }
}
