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

use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::Arc;

use embree4_sys as sys;

use super::device::Device;
use super::geometry::{Geometry, Handle, Kind, SurfacePoint, check_keys, keys_around};
use super::panics::PanicSlot;
use crate::error::{Fault, Result};
use crate::math::{Vec2, Vec3};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Crease, FaceVaryingInterpolation, Interpolation, Primvar,
    Scheme,
};

/// Corners of a face that Embree can subdivide (its MAX_PATCH_VALENCE).
const MAX_CORNERS: u32 = 16;
/// Faces around a point (its MAX_RING_FACE_VALENCE), less one for the border.
const MAX_FACES_AROUND: u32 = 63;
/// Points around a point (its MAX_RING_EDGE_VALENCE), less two for the border.
const MAX_POINTS_AROUND: u32 = 126;

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
    /// The same surface without displacement, for interpolation while the displaced one is built.
    twin: Option<Twin>,
    panics: Arc<PanicSlot>,
}

/// Where the values of a primvar come from.
enum Slot {
    /// Constant or uniform: read off the mesh's primvar of this index.
    Plain(usize),
    /// Embree's vertex attribute of this number, with so many components.
    Attribute(u32, usize),
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
        let surface = Box::new(Subdivision {
            mesh,
            slots,
            displacement: options.displacement,
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
    pub(super) fn point(&self, own: &Handle, face: u32, uv: Vec2, time: f32) -> SurfacePoint {
        let handle = self.twin.as_ref().map_or(own, |t| &t.handle);
        let uv = self.usable(face, uv);
        let (a, b, f) = keys_around(self.mesh.points.len(), time);
        let at = |key: usize| {
            let mut p = [[0.0_f32; 3]; 6];
            let [position, du, dv, duu, dvv, duv] = &mut p;
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
                ddPdudu: duu.as_mut_ptr(),
                ddPdvdv: dvv.as_mut_ptr(),
                ddPdudv: duv.as_mut_ptr(),
                valueCount: 3,
            };
            // SAFETY: the geometry is in a committed scene (the caller or the twin sees to it), face and
            // parameters are in range, and each array takes the three numbers.
            unsafe { sys::rtcInterpolate(&raw const args) };
            p.map(Vec3::from_array)
        };
        let mut p = at(a);
        if f > 0.0 {
            for (p, q) in p.iter_mut().zip(at(b)) {
                *p = p.lerp(q, f);
            }
        }
        let [position, du, dv, duu, dvv, duv] = p;
        SurfacePoint {
            position,
            du,
            dv,
            duu,
            duv,
            dvv,
        }
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

fn check_limits(mesh: &ControlMesh) -> Result<(), Fault> {
    if matches!(mesh.scheme, Scheme::Loop | Scheme::None) {
        return Err(Fault::new(format!(
            "Embree does not subdivide by scheme {:?}",
            mesh.scheme
        ))
        .advise("trace the refined triangles"));
    }
    if let Some(face) = mesh
        .face_vertex_counts
        .iter()
        .position(|&n| n > MAX_CORNERS)
    {
        let n = mesh.face_vertex_counts[face];
        return Err(Fault::new(format!(
            "{n} corners, where Embree subdivides at most {MAX_CORNERS}"
        ))
        .at_face(face)
        .advise("split the face, or use an intersection method other than Embree's own"));
    }
    // Faces and points around each point; a closed ring of faces has the sum of (corners - 2) points.
    let mut around = vec![[0_u32; 2]; mesh.point_count()];
    for (face, range) in mesh.faces().enumerate() {
        let corners = &mesh.face_vertex_indices[range];
        for &v in corners {
            let [faces, points] = &mut around[v as usize];
            *faces += 1;
            *points += corners.len() as u32 - 2;
            if *faces > MAX_FACES_AROUND || *points > MAX_POINTS_AROUND {
                return Err(Fault::new(format!(
                    "point {v} has more neighbours than Embree subdivides ({MAX_FACES_AROUND} faces, \
                     {MAX_POINTS_AROUND} points)"
                ))
                .at_face(face)
                .advise("divide the fan around it, or use an intersection method other than Embree's own"));
            }
        }
    }
    Ok(())
}

fn build_topology(handle: &Handle, mesh: &ControlMesh) -> Result<()> {
    let uint = sys::RTC_FORMAT_UINT;
    let float = sys::RTC_FORMAT_FLOAT;
    handle.set_keys(mesh.points.len());
    handle.fill(
        sys::RTC_BUFFER_TYPE_FACE,
        0,
        uint,
        1,
        &mesh.face_vertex_counts,
    )?;
    handle.fill(
        sys::RTC_BUFFER_TYPE_INDEX,
        0,
        uint,
        1,
        &mesh.face_vertex_indices,
    )?;
    handle.fill_points(&mesh.points)?;
    let weight = |s: f32| {
        if s >= Crease::INFINITE {
            f32::INFINITY
        } else {
            s
        }
    };
    if !mesh.creases.is_empty() {
        let edges: Vec<u32> = mesh.creases.iter().flat_map(|c| c.vertices).collect();
        let weights: Vec<f32> = mesh.creases.iter().map(|c| weight(c.sharpness)).collect();
        handle.fill(
            sys::RTC_BUFFER_TYPE_EDGE_CREASE_INDEX,
            0,
            sys::RTC_FORMAT_UINT2,
            2,
            &edges,
        )?;
        handle.fill(
            sys::RTC_BUFFER_TYPE_EDGE_CREASE_WEIGHT,
            0,
            float,
            1,
            &weights,
        )?;
    }
    if !mesh.corners.is_empty() {
        let points: Vec<u32> = mesh.corners.iter().map(|c| c.vertex).collect();
        let weights: Vec<f32> = mesh.corners.iter().map(|c| weight(c.sharpness)).collect();
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_CREASE_INDEX,
            0,
            uint,
            1,
            &points,
        )?;
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_CREASE_WEIGHT,
            0,
            float,
            1,
            &weights,
        )?;
    }
    if !mesh.holes.is_empty() {
        handle.fill(sys::RTC_BUFFER_TYPE_HOLE, 0, uint, 1, &mesh.holes)?;
    }
    let mode = match (mesh.scheme, mesh.boundary) {
        (Scheme::Bilinear, _) => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
        (_, BoundaryInterpolation::None) => sys::RTC_SUBDIVISION_MODE_NO_BOUNDARY,
        (_, BoundaryInterpolation::EdgeOnly) => sys::RTC_SUBDIVISION_MODE_SMOOTH_BOUNDARY,
        (_, BoundaryInterpolation::EdgeAndCorner) => sys::RTC_SUBDIVISION_MODE_PIN_CORNERS,
    };
    // SAFETY: the geometry is alive and a subdivision surface.
    unsafe { sys::rtcSetGeometrySubdivisionMode(handle.raw(), 0, mode) };
    handle.device.check()
}

fn set_rates(handle: &Handle, mesh: &ControlMesh, rates: &Rates) -> Result<()> {
    // NaN becomes 1. 4096 is Embree's own limit.
    let sane = |r: f32| r.max(1.0).min(4096.0);
    match rates {
        Rates::Uniform(rate) => {
            // SAFETY: the geometry is alive and a subdivision surface.
            unsafe { sys::rtcSetGeometryTessellationRate(handle.raw(), sane(*rate)) };
            handle.device.check()
        }
        Rates::PerCorner(rates) => {
            let (given, needed) = (rates.len(), mesh.face_vertex_indices.len());
            if given != needed {
                return Err(Fault::new(format!("{given} rates for {needed} corners")).into());
            }
            let rates: Vec<f32> = rates.iter().map(|&r| sane(r)).collect();
            handle.fill(
                sys::RTC_BUFFER_TYPE_LEVEL,
                0,
                sys::RTC_FORMAT_FLOAT,
                1,
                &rates,
            )
        }
    }
}

/// Gives Embree the primvars that vary over faces. Topology 0 is the points'; varying primvars share one more, and
/// each face-varying one has its own.
fn build_primvars(handle: &Handle, mesh: &ControlMesh, primvars: &[usize]) -> Result<Vec<Slot>> {
    let mut topologies: Vec<(Vec<u32>, sys::RTCSubdivisionMode)> = Vec::new();
    let mut varying = None;
    let mut attributes: Vec<(u32, usize, Vec<f32>)> = Vec::new();
    let mut slots = Vec::new();
    for &i in primvars {
        let primvar = &mesh.primvars[i];
        let width = primvar.width as usize;
        if width > 16 {
            return Err(Fault::new(format!(
                "primvar {} has {width} components, more than 16",
                primvar.name
            ))
            .into());
        }
        let (topology, values) = match primvar.interpolation {
            Interpolation::Constant | Interpolation::Uniform => {
                slots.push(Slot::Plain(i));
                continue;
            }
            Interpolation::Vertex => (0, per_point(mesh, primvar)),
            Interpolation::Varying => {
                let topology = *varying.get_or_insert_with(|| {
                    topologies.push((
                        mesh.face_vertex_indices.clone(),
                        sys::RTC_SUBDIVISION_MODE_PIN_ALL,
                    ));
                    topologies.len() as u32
                });
                (topology, per_point(mesh, primvar))
            }
            Interpolation::FaceVarying => {
                let (indices, values) = per_corner(mesh, primvar);
                topologies.push((indices, face_varying_mode(mesh)));
                (topologies.len() as u32, values)
            }
        };
        slots.push(Slot::Attribute(attributes.len() as u32, width));
        attributes.push((topology, width, values));
    }
    // SAFETY: the geometry is alive and a subdivision surface.
    unsafe {
        sys::rtcSetGeometryTopologyCount(handle.raw(), topologies.len() as u32 + 1);
        sys::rtcSetGeometryVertexAttributeCount(handle.raw(), attributes.len() as u32);
    }
    for (number, (indices, mode)) in (1..).zip(&topologies) {
        handle.fill(
            sys::RTC_BUFFER_TYPE_INDEX,
            number,
            sys::RTC_FORMAT_UINT,
            1,
            indices,
        )?;
        // SAFETY: as above; the topology exists.
        unsafe { sys::rtcSetGeometrySubdivisionMode(handle.raw(), number, *mode) };
    }
    for (number, (topology, width, values)) in (0..).zip(&attributes) {
        // Formats of 1 to 16 floats follow one another.
        let format = sys::RTC_FORMAT_FLOAT + *width as u32 - 1;
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_ATTRIBUTE,
            number,
            format,
            *width,
            values,
        )?;
        // SAFETY: as above; attribute and topology exist.
        unsafe { sys::rtcSetGeometryVertexAttributeTopology(handle.raw(), number, *topology) };
    }
    handle.device.check()?;
    Ok(slots)
}

fn face_varying_mode(mesh: &ControlMesh) -> sys::RTCSubdivisionMode {
    use FaceVaryingInterpolation as F;
    match mesh.face_varying {
        _ if mesh.scheme == Scheme::Bilinear => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
        F::None => sys::RTC_SUBDIVISION_MODE_SMOOTH_BOUNDARY,
        F::CornersOnly | F::CornersPlus1 | F::CornersPlus2 => sys::RTC_SUBDIVISION_MODE_PIN_CORNERS,
        F::Boundaries => sys::RTC_SUBDIVISION_MODE_PIN_BOUNDARY,
        F::All => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
    }
}

fn per_point(mesh: &ControlMesh, primvar: &Primvar) -> Vec<f32> {
    (0..mesh.point_count())
        .flat_map(|i| primvar.get(i))
        .copied()
        .collect()
}

/// Corners of one point with one value are one; others are apart, even if they have the same element, so that
/// the topology is that of the points, cut at seams.
fn per_corner(mesh: &ControlMesh, primvar: &Primvar) -> (Vec<u32>, Vec<f32>) {
    let mut known: HashMap<(u32, Vec<u32>), u32> = HashMap::new();
    let mut values = Vec::new();
    let indices = mesh
        .face_vertex_indices
        .iter()
        .enumerate()
        .map(|(corner, &point)| {
            let value = primvar.get(corner);
            let key = match &primvar.indices {
                Some(indices) => vec![indices[corner]],
                None => value.iter().map(|x| x.to_bits()).collect(),
            };
            let next = known.len() as u32;
            *known.entry((point, key)).or_insert_with(|| {
                values.extend_from_slice(value);
                next
            })
        })
        .collect();
    (indices, values)
}

unsafe extern "C" fn displace(args: *const sys::RTCDisplacementFunctionNArguments) {
    // SAFETY: Embree's arguments are valid during the call, and its user pointer is the one set above.
    let (args, surface) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<Subdivision>()) };
    let Some(displacement) = &surface.displacement else {
        return;
    };
    let sign = if surface.mesh.left_handed { -1.0 } else { 1.0 };
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
            let moved = position
                + displacement(&DisplacementPoint {
                    face: args.primID,
                    uv,
                    key: args.timeStep,
                    position,
                    normal: sign * normal.normalize_or_zero(),
                    surface,
                });
            // SAFETY: as above; Embree lets us write the points.
            unsafe {
                *args.P_x.add(i) = moved.x;
                *args.P_y.add(i) = moved.y;
                *args.P_z.add(i) = moved.z;
            }
        }
    });
}
