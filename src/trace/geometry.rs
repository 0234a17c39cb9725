//! Geometries: handles, buffers, and points on them.
#![allow(unsafe_code)]

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use embree4_sys as sys;

use super::device::Device;
use super::filter::Kept;
use super::panics::PanicSlot;
use super::scene::Scene;
use super::subdivision::Subdivision;
use crate::error::{Fault, Result};
use crate::math::{Vec2, Vec3};

/// Points of a mesh at each motion key.
pub(super) type Keys = Arc<Vec<Vec<Vec3>>>;

/// One surface for Embree, with everything that it points to.
pub struct Geometry {
    // Dropped in this order: Embree's object first, then what it points to.
    pub(super) handle: Handle,
    pub(super) kind: Kind,
    /// What decides which hits count, if something does.
    pub(super) kept: Option<Box<Kept>>,
    pub(super) panics: Arc<PanicSlot>,
    pub(super) keys: usize,
    /// Whether Embree's normal points to the back.
    pub(super) flipped: bool,
    /// Whether a committed scene holds it: only then may Embree interpolate.
    pub(super) ready: AtomicBool,
}

pub(super) enum Kind {
    Triangles(Vec<[u32; 3]>, Keys),
    Grids(Vec<Grid>, Keys),
    /// Micro-triangles of a surface that answers for its points itself.
    Diced,
    Subdivision(Box<Subdivision>),
    /// What the callbacks borrow.
    User(#[expect(dead_code, reason = "owned for Embree's sake")] Box<dyn Any + Send + Sync>),
    Instance(Arc<Scene>),
}

/// A rectangle of points, row by row, meshed with quads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// The first point of the first row.
    pub start_vertex: u32,
    /// Points from the start of a row to the start of the next.
    pub stride: u32,
    /// Points in a row, 2 to 32767.
    pub width: u16,
    /// Rows, 2 to 32767.
    pub height: u16,
}

/// A point on a surface, with derivatives by the two parameters of the hit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SurfacePoint {
    /// The point.
    pub position: Vec3,
    /// Derivative by u.
    pub du: Vec3,
    /// Derivative by v.
    pub dv: Vec3,
}

impl Geometry {
    /// Triangles over points at one or more motion keys, evenly over the shutter.
    ///
    /// # Errors
    /// If indices are out of range, keys differ in length, or memory runs out.
    pub fn triangles(device: &Device, indices: Vec<[u32; 3]>, keys: Keys) -> Result<Self> {
        let handle = Self::triangle_handle(device, &indices, &keys)?;
        let count = keys.len();
        Ok(Self::from_parts(
            handle,
            Kind::Triangles(indices, keys),
            count,
        ))
    }

    pub(super) fn triangle_handle(
        device: &Device,
        indices: &[[u32; 3]],
        keys: &[Vec<Vec3>],
    ) -> Result<Handle> {
        let points = check_keys(keys)?;
        if let Some(i) = indices
            .iter()
            .position(|t| t.iter().any(|&v| v as usize >= points))
        {
            return Err(Fault::new(format!(
                "a triangle names points {:?} of {points}",
                indices[i]
            ))
            .at_face(i)
            .into());
        }
        let handle = Handle::new(device, sys::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        handle.set_keys(keys.len());
        handle.fill(
            sys::RTC_BUFFER_TYPE_INDEX,
            0,
            sys::RTC_FORMAT_UINT3,
            3,
            indices.as_flattened(),
        )?;
        handle.fill_points(keys)?;
        handle.commit()?;
        Ok(handle)
    }

    /// Grids over points at one or more motion keys. A hit's uv runs over the whole grid.
    ///
    /// # Errors
    /// If a grid leaves the points, keys differ in length, or memory runs out.
    pub fn grid(device: &Device, grids: Vec<Grid>, keys: Keys) -> Result<Self> {
        let handle = Self::grid_handle(device, &grids, &keys)?;
        let count = keys.len();
        Ok(Self::from_parts(handle, Kind::Grids(grids, keys), count))
    }

    pub(super) fn grid_handle(
        device: &Device,
        grids: &[Grid],
        keys: &[Vec<Vec3>],
    ) -> Result<Handle> {
        let points = check_keys(keys)? as u64;
        for (i, g) in grids.iter().enumerate() {
            let side = 2..=0x7fff;
            let last = u64::from(g.start_vertex)
                + u64::from(g.stride) * u64::from(g.height.saturating_sub(1))
                + u64::from(g.width.saturating_sub(1));
            if !side.contains(&g.width) || !side.contains(&g.height) || last >= points {
                return Err(Fault::new(format!("{g:?} does not fit {points} points"))
                    .at_face(i)
                    .into());
            }
        }
        let handle = Handle::new(device, sys::RTC_GEOMETRY_TYPE_GRID)?;
        handle.set_keys(keys.len());
        let raw: Vec<u32> = grids
            .iter()
            .flat_map(|g| {
                // RTCGrid: two 32-bit numbers, then two 16-bit ones.
                let [a, b] = g.width.to_ne_bytes();
                let [c, d] = g.height.to_ne_bytes();
                [g.start_vertex, g.stride, u32::from_ne_bytes([a, b, c, d])]
            })
            .collect();
        handle.fill(sys::RTC_BUFFER_TYPE_GRID, 0, sys::RTC_FORMAT_GRID, 3, &raw)?;
        handle.fill_points(keys)?;
        handle.commit()?;
        Ok(handle)
    }

    /// The point at parameters `uv` of a primitive: of the limit surface without displacement, or of the flat
    /// triangle, or of the grid's bilinear quad. On a left-handed mesh `du × dv` points to the back.
    ///
    /// # Panics
    /// If there is no such primitive, for user geometry and diced surfaces, and for subdivision surfaces before the scene that
    /// they are attached to is committed.
    pub fn surface_point(&self, primitive: u32, uv: Vec2, time: f32) -> SurfacePoint {
        match &self.kind {
            Kind::Triangles(indices, keys) => {
                let [a, b, c] = indices[primitive as usize].map(|v| at_time(keys, v, time));
                let (du, dv) = (b - a, c - a);
                SurfacePoint {
                    position: a + uv.x * du + uv.y * dv,
                    du,
                    dv,
                }
            }
            Kind::Grids(grids, keys) => {
                let g = grids[primitive as usize];
                let cells = Vec2::new(f32::from(g.width - 1), f32::from(g.height - 1));
                let st = uv.clamp(Vec2::ZERO, Vec2::ONE) * cells;
                let cell = st.floor().min(cells - 1.0);
                let (s, t) = (st - cell).into();
                let first = g.start_vertex + cell.y as u32 * g.stride + cell.x as u32;
                let p = |x, y| at_time(keys, first + y * g.stride + x, time);
                let (p00, p10, p01, p11) = (p(0, 0), p(1, 0), p(0, 1), p(1, 1));
                SurfacePoint {
                    position: p00.lerp(p10, s).lerp(p01.lerp(p11, s), t),
                    du: cells.x * (p10 - p00).lerp(p11 - p01, t),
                    dv: cells.y * (p01 - p00).lerp(p11 - p10, s),
                }
            }
            Kind::Subdivision(surface) => {
                assert!(self.is_ready(), "commit the scene before asking for points");
                surface.point(&self.handle, primitive, uv, time)
            }
            Kind::Diced | Kind::User(_) | Kind::Instance(_) => {
                panic!("only meshes have surface points")
            }
        }
    }

    /// As [`surface_point`](Self::surface_point), of the displaced surface where there is displacement, without
    /// second derivatives there.
    ///
    /// # Panics
    /// As for [`surface_point`](Self::surface_point).
    pub fn displaced_point(&self, primitive: u32, uv: Vec2, time: f32) -> SurfacePoint {
        match &self.kind {
            Kind::Subdivision(surface) if surface.is_displaced() => {
                assert!(self.is_ready(), "commit the scene before asking for points");
                surface.displaced_point(&self.handle, primitive, uv, time)
            }
            _ => self.surface_point(primitive, uv, time),
        }
    }

    /// The value of a primvar: `slot` counts in the options' `primvars`; `out` takes as many components as it is
    /// long, at most the primvar's width.
    ///
    /// # Panics
    /// As for [`surface_point`](Self::surface_point); also for all but subdivision surfaces, and if there is no
    /// such slot or it has fewer components.
    pub fn primvar(&self, slot: usize, primitive: u32, uv: Vec2, out: &mut [f32]) {
        let Kind::Subdivision(surface) = &self.kind else {
            panic!("only subdivision surfaces interpolate primvars");
        };
        assert!(
            self.is_ready(),
            "commit the scene before asking for primvars"
        );
        surface.primvar(&self.handle, slot, primitive, uv, out);
    }

    /// How many motion keys it has.
    pub fn keys(&self) -> usize {
        self.keys
    }

    /// Bytes of its own beside Embree's; without what an intersector holds, control meshes and instanced scenes.
    pub fn memory(&self) -> usize {
        let points = |keys: &Keys| {
            keys.iter()
                .map(|key| size_of_val(key.as_slice()))
                .sum::<usize>()
        };
        match &self.kind {
            Kind::Triangles(indices, keys) => size_of_val(indices.as_slice()) + points(keys),
            Kind::Grids(grids, keys) => size_of_val(grids.as_slice()) + points(keys),
            Kind::Diced | Kind::Subdivision(_) | Kind::User(_) | Kind::Instance(_) => 0,
        }
    }

    fn is_ready(&self) -> bool {
        self.ready.load(Ordering::Acquire)
    }

    pub(super) fn from_parts(handle: Handle, kind: Kind, keys: usize) -> Self {
        Self {
            handle,
            kind,
            kept: None,
            panics: Arc::default(),
            keys,
            flipped: false,
            ready: AtomicBool::new(false),
        }
    }
}

/// An owned reference to one of Embree's geometries.
pub(super) struct Handle {
    raw: sys::RTCGeometry,
    pub(super) device: Device,
}

// SAFETY: Embree's geometries are reference-counted with atomics. They are changed only while one thread owns
// them (before they are attached); afterwards they are only read (rtcInterpolate is thread-safe).
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Handle {
    pub(super) fn new(device: &Device, kind: sys::RTCGeometryType) -> Result<Self> {
        device.settle();
        // SAFETY: the device is alive.
        let raw = unsafe { sys::rtcNewGeometry(device.handle(), kind) };
        device.check()?;
        // SAFETY: the geometry was just made. Embree 3 and 4 start with different masks, so none is relied on.
        unsafe { sys::rtcSetGeometryMask(raw, u32::MAX) };
        Ok(Self {
            raw,
            device: device.clone(),
        })
    }

    pub(super) fn raw(&self) -> sys::RTCGeometry {
        self.raw
    }

    pub(super) fn set_keys(&self, keys: usize) {
        // SAFETY: the geometry is alive; the count was checked to be within Embree's limit.
        unsafe { sys::rtcSetGeometryTimeStepCount(self.raw, keys as u32) };
    }

    /// Copies `data` into a new buffer of Embree's, `components` 32-bit numbers an item.
    ///
    /// Embree loads 16 bytes from each item of a vertex buffer. It allocates the excess after the last one but
    /// leaves it as it is, and its checked builds stop the process where that is not a finite number by chance.
    /// So such buffers end with items of zeros here, which no index names.
    pub(super) fn fill<T: Number>(
        &self,
        buffer: sys::RTCBufferType,
        slot: u32,
        format: sys::RTCFormat,
        components: usize,
        data: &[T],
    ) -> Result<()> {
        let items = data.len() / components;
        let is_vertices = matches!(
            buffer,
            sys::RTC_BUFFER_TYPE_VERTEX | sys::RTC_BUFFER_TYPE_VERTEX_ATTRIBUTE
        );
        let excess = components.next_multiple_of(4) - components;
        let zeros = if is_vertices {
            excess.div_ceil(components)
        } else {
            0
        };
        self.device.settle();
        // SAFETY: the geometry is alive; format and stride agree (4 bytes a component).
        let to = unsafe {
            sys::rtcSetNewGeometryBuffer(
                self.raw,
                buffer,
                slot,
                format,
                4 * components,
                items + zeros,
            )
        };
        self.device.check()?;
        if items + zeros > 0 {
            assert!(!to.is_null(), "Embree gave no buffer and no error");
            let to = to.cast::<T>();
            let used = items * components;
            // SAFETY: the buffer has `items + zeros` items of `components` numbers of 4 bytes, is aligned to 16
            // bytes and new; zero bits are a number of either type.
            unsafe {
                std::ptr::copy_nonoverlapping(data.as_ptr(), to, used);
                std::ptr::write_bytes(to.add(used), 0, zeros * components);
            }
        }
        Ok(())
    }

    pub(super) fn fill_points(&self, keys: &[Vec<Vec3>]) -> Result<()> {
        for (key, points) in keys.iter().enumerate() {
            let numbers: &[f32] = bytemuck::cast_slice(points);
            let (vertex, float3) = (sys::RTC_BUFFER_TYPE_VERTEX, sys::RTC_FORMAT_FLOAT3);
            self.fill(vertex, key as u32, float3, 3, numbers)?;
        }
        Ok(())
    }

    pub(super) fn commit(&self) -> Result<()> {
        self.device.settle();
        // SAFETY: the geometry is alive and not yet in a scene.
        unsafe { sys::rtcCommitGeometry(self.raw) };
        self.device.check()
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: our own reference, released once; the device is dropped after it.
        unsafe { sys::rtcReleaseGeometry(self.raw) }
    }
}

/// What buffers hold: numbers of four bytes.
pub(super) trait Number: Copy {}
impl Number for u32 {}
impl Number for f32 {}

/// How many points each key has.
pub(super) fn check_keys(keys: &[Vec<Vec3>]) -> Result<usize> {
    let count = keys.first().map_or(0, Vec::len);
    check_key_count(keys.len())?;
    if keys.iter().any(|k| k.len() != count) {
        return Err(Fault::new("motion keys have different numbers of points").into());
    }
    Ok(count)
}

pub(super) fn check_key_count(keys: usize) -> Result<()> {
    // Embree's limit.
    let most = sys::RTC_MAX_TIME_STEP_COUNT as usize;
    if (1..=most).contains(&keys) {
        return Ok(());
    }
    Err(Fault::new(format!(
        "{keys} motion keys, where 1 to {most} are possible"
    ))
    .advise("author fewer samples within the shutter")
    .into())
}

/// The two keys around `time` (0..1), and how far it is from the first to the second.
pub(super) fn keys_around(keys: usize, time: f32) -> (usize, usize, f32) {
    let last = keys - 1;
    let x = time.clamp(0.0, 1.0) * last as f32;
    let first = (x as usize).min(last.saturating_sub(1));
    (first, (first + 1).min(last), x - first as f32)
}

fn at_time(keys: &[Vec<Vec3>], vertex: u32, time: f32) -> Vec3 {
    let (a, b, f) = keys_around(keys.len(), time);
    let v = vertex as usize;
    if f == 0.0 {
        keys[a][v]
    } else {
        keys[a][v].lerp(keys[b][v], f)
    }
}
