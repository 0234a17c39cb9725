//! Subdivision surfaces: a control mesh handed to Embree, its primvars, and displacement while it is built.
//!
//! Embree subdivides faces of 4 corners with parameters over the whole face,
//!
//! ```text
//!   3 --- 2      u from corner 0 to corner 1,
//!   |     |      v from corner 0 to corner 3
//!   0 --- 1
//! ```
//!
//! and all others by the quads of the first subdivision step: see [`sub_face_of`]. Corners go to Embree in the
//! mesh's order; for left-handed meshes the normals (of hits and for displacement) are turned round instead, so
//! that parameters, rates and primvars keep their meaning. Creases apply with the uniform rule and triangles
//! like any face: Chaikin creases and smooth triangles are not in Embree, and the caller has to warn.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::Arc;

use embree4_sys as sys;

use super::control::{Slot, build_primvars, build_topology, check_limits, set_rates};
use super::device::Device;
use super::geometry::{Geometry, Handle, Kind, SurfacePoint, check_keys, keys_around};
use super::panics::PanicSlot;
use crate::error::{Fault, Result};
use crate::math::{Vec2, Vec3};
use crate::mesh::{ControlMesh, Interpolation};

/// How to hand a control mesh to Embree.
#[derive(Clone)]
pub struct SubdivisionOptions {
    /// Into how many segments edges are split.
    pub rates: Rates,
    /// Moves the surface's points while it is built.
    pub displacement: Option<Displacement>,
    /// The names of primvars to interpolate; their slots are their places in this list.
    pub primvars: Vec<String>,
}

/// Into how many segments edges are split, at least 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Rates {
    /// All edges alike.
    Uniform(f32),
    /// The edge from each corner to the next of its face; the two sides of an edge must agree.
    PerCorner(Vec<f32>),
}

/// By how much a point of the surface moves. Called on many threads at once.
pub type Displacement = Arc<dyn Fn(&DisplacementPoint<'_>) -> Vec3 + Send + Sync>;

/// A point to be displaced.
pub struct DisplacementPoint<'a> {
    /// The control mesh's face.
    pub face: u32,
    /// Parameters on it, as of hits.
    pub uv: Vec2,
    /// The motion key.
    pub key: u32,
    /// The limit surface's point.
    pub position: Vec3,
    /// Its unit normal, to the front.
    pub normal: Vec3,
    surface: &'a Subdivision,
}

impl DisplacementPoint<'_> {
    /// The value here of a primvar, as [`Geometry::primvar`].
    ///
    /// # Panics
    /// If there is no such slot, or `out` has more components than it.
    pub fn primvar(&self, slot: usize, out: &mut [f32]) {
        let twin = self
            .surface
            .twin
            .as_ref()
            .expect("displaced surfaces have a twin");
        self.surface
            .value(&twin.handle, slot, self.face, self.uv, out);
    }
}

pub(super) struct Subdivision {
    mesh: Arc<ControlMesh>,
    slots: Vec<Slot>,
    displacement: Option<Displacement>,
    /// Half a micro-edge in the parameters of each face, if there is displacement.
    steps: Vec<f32>,
    /// The same surface without displacement, for interpolation while the displaced one is built.
    twin: Option<Twin>,
    panics: Arc<PanicSlot>,
}

struct Twin {
    scene: sys::RTCScene,
    handle: Handle,
}

// SAFETY: the scene is never touched after it is committed but to be released; handles are Send and Sync.
unsafe impl Send for Twin {}
// SAFETY: as above.
unsafe impl Sync for Twin {}

impl Drop for Twin {
    fn drop(&mut self) {
        // SAFETY: our own reference, released once, while the geometry and the device are alive.
        unsafe { sys::rtcReleaseScene(self.scene) }
    }
}

impl Geometry {
    /// The limit surface of a control mesh, tessellated by the given rates when its scene is committed.
    ///
    /// # Errors
    /// A fault if the mesh is not valid, is of another scheme than Catmull-Clark or bilinear, has faces or points
    /// with more neighbours than Embree can hold, or lacks a primvar; or if memory runs out.
    pub fn subdivision(
        device: &Device,
        mesh: Arc<ControlMesh>,
        options: SubdivisionOptions,
    ) -> Result<Self> {
        mesh.validate()?;
        check_keys(&mesh.points)?;
        check_limits(&mesh)?;
        let primvars: Vec<usize> = options
            .primvars
            .iter()
            .map(|name| {
                mesh.primvars
                    .iter()
                    .position(|p| &p.name == name)
                    .ok_or_else(|| Fault::new(format!("the mesh has no primvar {name}")))
            })
            .collect::<Result<_, _>>()?;

        let handle = Handle::new(device, sys::RTC_GEOMETRY_TYPE_SUBDIVISION)?;
        build_topology(&handle, &mesh)?;
        set_rates(&handle, &mesh, &options.rates)?;
        let mut twin = None;
        let slots = if options.displacement.is_some() {
            let inner = Handle::new(device, sys::RTC_GEOMETRY_TYPE_SUBDIVISION)?;
            build_topology(&inner, &mesh)?;
            set_rates(&inner, &mesh, &Rates::Uniform(1.0))?;
            let slots = build_primvars(&inner, &mesh, &primvars)?;
            inner.commit()?;
            // SAFETY: the device is alive.
            let scene = unsafe { sys::rtcNewScene(device.handle()) };
            let made = twin.insert(Twin {
                scene,
                handle: inner,
            });
            // SAFETY: scene and geometry are alive and owned by the twin.
            unsafe {
                sys::rtcAttachGeometry(scene, made.handle.raw());
                sys::rtcCommitScene(scene);
            }
            device.check()?;
            slots
        } else {
            build_primvars(&handle, &mesh, &primvars)?
        };

        let panics = Arc::<PanicSlot>::default();
        let (keys, flipped) = (mesh.points.len(), mesh.left_handed);
        let steps = match &options.displacement {
            Some(_) => half_micro_edges(&mesh, &options.rates),
            None => Vec::new(),
        };
        let surface = Box::new(Subdivision {
            mesh,
            slots,
            displacement: options.displacement,
            steps,
            twin,
            panics: Arc::clone(&panics),
        });
        if surface.displacement.is_some() {
            let pointer: *const Subdivision = &raw const *surface;
            // SAFETY: the box stays where it is until Embree's geometry is released; the callback borrows it.
            unsafe {
                sys::rtcSetGeometryUserData(handle.raw(), pointer.cast_mut().cast::<c_void>());
                sys::rtcSetGeometryDisplacementFunction(handle.raw(), Some(displace));
            }
        }
        handle.commit()?;
        let mut geometry = Self::from_parts(handle, Kind::Subdivision(surface), keys);
        geometry.panics = panics;
        geometry.flipped = flipped;
        Ok(geometry)
    }
}

impl Subdivision {
    pub(super) fn is_displaced(&self) -> bool {
        self.displacement.is_some()
    }

    pub(super) fn point(&self, own: &Handle, face: u32, uv: Vec2, time: f32) -> SurfacePoint {
        let (a, b, f) = keys_around(self.mesh.points.len(), time);
        let mut p = self.point_at(own, face, uv, a);
        if f > 0.0 {
            let q = self.point_at(own, face, uv, b);
            for (p, q) in p.iter_mut().zip(q) {
                *p = p.lerp(q, f);
            }
        }
        let [position, du, dv] = p;
        SurfacePoint { position, du, dv }
    }

    /// At a motion key: the point and its derivatives by u and v.
    fn point_at(&self, own: &Handle, face: u32, uv: Vec2, key: usize) -> [Vec3; 3] {
        let handle = self.twin.as_ref().map_or(own, |t| &t.handle);
        let uv = self.usable(face, uv);
        let mut p = [[0.0_f32; 3]; 3];
        let [position, du, dv] = &mut p;
        let args = sys::RTCInterpolateArguments {
            geometry: handle.raw(),
            primID: face,
            u: uv.x,
            v: uv.y,
            bufferType: sys::RTC_BUFFER_TYPE_VERTEX,
            bufferSlot: key as u32,
            P: position.as_mut_ptr(),
            dPdu: du.as_mut_ptr(),
            dPdv: dv.as_mut_ptr(),
            valueCount: 3,
            ..Default::default()
        };
        // SAFETY: the geometry is in a committed scene (the caller or the twin sees to it), face and
        // parameters are in range, and each array takes the three numbers.
        unsafe { sys::rtcInterpolate(&raw const args) };
        p.map(Vec3::from_array)
    }

    /// The displaced surface itself, not its facets: the point, and first derivatives by differences over a
    /// micro-edge, so that they hold what the facets can show and no more.
    pub(super) fn displaced_point(
        &self,
        own: &Handle,
        face: u32,
        uv: Vec2,
        time: f32,
    ) -> SurfacePoint {
        let (a, b, f) = keys_around(self.mesh.points.len(), time);
        let at = |uv: Vec2| {
            let p = self.displaced_at(own, face, uv, a);
            if f > 0.0 {
                p.lerp(self.displaced_at(own, face, uv, b), f)
            } else {
                p
            }
        };
        // Stay within the quad that the parameters are on.
        let (corner, inner) = match self.mesh.face_vertex_counts[face as usize] {
            4 => (None, clamp(uv)),
            n => {
                let (corner, inner) = sub_face_of(uv);
                (Some(corner.min(n - 1)), inner)
            }
        };
        let on_quad = |inner| at(corner.map_or(inner, |corner| face_uv(corner, inner)));
        let step = self.steps[face as usize];
        let position = on_quad(inner);
        let along = |axis: Vec2| {
            let ahead = inner + step * axis;
            let behind = inner - step * axis;
            // At a border the three-point difference to one side, as exact as the central one: the two faces at
            // an edge agree.
            if behind.dot(axis) < 0.0 {
                let further = on_quad(ahead + step * axis);
                (4.0 * on_quad(ahead) - 3.0 * position - further) / (2.0 * step)
            } else if ahead.dot(axis) > 1.0 {
                let further = on_quad(behind - step * axis);
                (3.0 * position - 4.0 * on_quad(behind) + further) / (2.0 * step)
            } else {
                (on_quad(ahead) - on_quad(behind)) / (2.0 * step)
            }
        };
        SurfacePoint {
            position,
            du: along(Vec2::X),
            dv: along(Vec2::Y),
        }
    }

    fn displaced_at(&self, own: &Handle, face: u32, uv: Vec2, key: usize) -> Vec3 {
        let [position, du, dv] = self.point_at(own, face, uv, key);
        self.displaced(face, uv, key as u32, position, du.cross(dv))
    }

    /// Where displacement takes a point of the limit surface; `normal` is Embree's, of any length.
    fn displaced(&self, face: u32, uv: Vec2, key: u32, position: Vec3, normal: Vec3) -> Vec3 {
        let Some(displacement) = &self.displacement else {
            return position;
        };
        let sign = if self.mesh.left_handed { -1.0 } else { 1.0 };
        position
            + displacement(&DisplacementPoint {
                face,
                uv,
                key,
                position,
                normal: sign * normal.normalize_or_zero(),
                surface: self,
            })
    }

    pub(super) fn primvar(&self, own: &Handle, slot: usize, face: u32, uv: Vec2, out: &mut [f32]) {
        let handle = self.twin.as_ref().map_or(own, |t| &t.handle);
        self.value(handle, slot, face, uv, out);
    }

    fn value(&self, handle: &Handle, slot: usize, face: u32, uv: Vec2, out: &mut [f32]) {
        match self.slots[slot] {
            Slot::Plain(i) => {
                let primvar = &self.mesh.primvars[i];
                let uniform = primvar.interpolation == Interpolation::Uniform;
                let element = primvar.get(if uniform { face as usize } else { 0 });
                out.copy_from_slice(&element[..out.len()]);
            }
            Slot::Attribute(attribute, width) => {
                assert!(out.len() <= width, "the primvar has {width} components");
                let uv = self.usable(face, uv);
                let args = sys::RTCInterpolateArguments {
                    geometry: handle.raw(),
                    primID: face,
                    u: uv.x,
                    v: uv.y,
                    bufferType: sys::RTC_BUFFER_TYPE_VERTEX_ATTRIBUTE,
                    bufferSlot: attribute,
                    P: out.as_mut_ptr(),
                    valueCount: out.len() as u32,
                    ..Default::default()
                };
                // SAFETY: as in `point`; `out` takes as many numbers as it is long.
                unsafe { sys::rtcInterpolate(&raw const args) };
            }
        }
    }

    /// `uv` within the face: Embree reads wild where parameters are but slightly outside, as hits' may be.
    fn usable(&self, face: u32, uv: Vec2) -> Vec2 {
        match self.mesh.face_vertex_counts[face as usize] {
            4 => clamp(uv),
            n => {
                let (corner, inner) = sub_face_of(uv);
                face_uv(corner.min(n - 1), inner)
            }
        }
    }
}

fn half_micro_edges(mesh: &ControlMesh, rates: &Rates) -> Vec<f32> {
    mesh.faces()
        .map(|corners| {
            let rate = match rates {
                Rates::Uniform(rate) => *rate,
                Rates::PerCorner(rates) => rates[corners].iter().copied().fold(1.0, f32::max),
            };
            0.5 / rate.max(1.0)
        })
        .collect()
}

/// On a face of other than 4 corners: which corner's quad the parameters are on, and those on it, 0..1: u towards
/// the middle of the edge to the next corner, v towards that of the edge to the corner before.
pub fn sub_face_of(uv: Vec2) -> (u32, Vec2) {
    let tile = (0.5 * uv).floor().clamp(Vec2::ZERO, Vec2::splat(3.0));
    let inner = clamp(uv - 2.0 * tile - 0.5);
    (4 * tile.y as u32 + tile.x as u32, inner)
}

/// The parameters on a face of other than 4 corners that [`sub_face_of`] takes apart.
pub fn face_uv(corner: u32, uv: Vec2) -> Vec2 {
    2.0 * Vec2::new((corner % 4) as f32, (corner / 4) as f32) + 0.5 + clamp(uv)
}

/// Within 0..1; NaN becomes 0.
fn clamp(uv: Vec2) -> Vec2 {
    uv.max(Vec2::ZERO).min(Vec2::ONE)
}

unsafe extern "C" fn displace(args: *const sys::RTCDisplacementFunctionNArguments) {
    // SAFETY: Embree's arguments are valid during the call, and its user pointer is the one set above.
    let (args, surface) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<Subdivision>()) };
    surface.panics.guard((), || {
        for i in 0..args.N as usize {
            // SAFETY: each of these arrays has N numbers.
            let (uv, normal, position) = unsafe {
                (
                    Vec2::new(*args.u.add(i), *args.v.add(i)),
                    Vec3::new(*args.Ng_x.add(i), *args.Ng_y.add(i), *args.Ng_z.add(i)),
                    Vec3::new(*args.P_x.add(i), *args.P_y.add(i), *args.P_z.add(i)),
                )
            };
            let moved = surface.displaced(args.primID, uv, args.timeStep, position, normal);
            // SAFETY: as above; Embree lets us write the points.
            unsafe {
                *args.P_x.add(i) = moved.x;
                *args.P_y.add(i) = moved.y;
                *args.P_z.add(i) = moved.z;
            }
        }
    });
}
