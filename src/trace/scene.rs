//! Scenes: built once, then asked by all threads.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use embree4_sys as sys;

use super::device::Device;
use super::geometry::{Geometry, Handle, Kind, check_key_count};
use super::panics::PanicSlot;
use crate::error::{Error, Result};
use crate::math::{Affine3A, Bounds3, Ray, Vec2, Vec3};

/// How Embree shall build a scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SceneOptions {
    /// No misses at shared edges, for some speed.
    pub robust: bool,
    /// Less memory, for some speed.
    pub compact: bool,
}

/// Gathers geometries and instances for a [`Scene`].
pub struct SceneBuilder {
    scene: Scene,
}

/// A committed scene.
pub struct Scene {
    // Dropped in this order: Embree's scene first, then what it refers to.
    handle: SceneHandle,
    geometries: Vec<Arc<Geometry>>,
    bounds: Bounds3,
    device: Device,
}

/// Where a ray met a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneHit {
    /// Ray parameter.
    pub t: f32,
    /// Parameters on the primitive. On subdivided faces of other than 4 corners see
    /// [`sub_face_of`](super::sub_face_of).
    pub uv: Vec2,
    /// Unnormalised geometric normal towards the front, in the space of the geometry (of the instanced scene, if
    /// any).
    pub normal: Vec3,
    /// The geometry's primitive.
    pub primitive: u32,
    /// The geometry's number in its scene.
    pub geometry: u32,
    /// The instance's number in the scene that was asked, if the geometry is in an instanced one.
    pub instance: Option<u32>,
    /// What an intersector gave as the hit's face; the primitive for other geometries.
    pub face: u32,
    /// What an intersector gave as its error; 0 for other geometries.
    pub error: f32,
}

impl SceneBuilder {
    /// An empty scene.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, options: SceneOptions) -> Result<Self> {
        device.settle();
        // SAFETY: the device is alive.
        let raw = unsafe { sys::rtcNewScene(device.handle()) };
        device.check()?;
        let handle = SceneHandle(raw);
        let mut flags = sys::RTC_SCENE_FLAG_NONE;
        if options.robust {
            flags |= sys::RTC_SCENE_FLAG_ROBUST;
        }
        if options.compact {
            flags |= sys::RTC_SCENE_FLAG_COMPACT;
        }
        // SAFETY: the scene was just made.
        unsafe { sys::rtcSetSceneFlags(raw, flags) };
        Ok(Self {
            scene: Scene {
                handle,
                geometries: Vec::new(),
                bounds: Bounds3::EMPTY,
                device: device.clone(),
            },
        })
    }

    /// Adds a geometry, which may be in other scenes, too. Its number is the count of those before it.
    ///
    /// # Panics
    /// If it was made with another device.
    pub fn attach(&mut self, geometry: impl Into<Arc<Geometry>>) -> u32 {
        let geometry = geometry.into();
        assert!(
            geometry.handle.device.is(&self.scene.device),
            "a geometry of another device"
        );
        let id = self.scene.geometries.len() as u32;
        // SAFETY: both are alive; the number is free. The scene keeps the geometry and all it points to.
        unsafe { sys::rtcAttachGeometryByID(self.scene.handle.0, geometry.handle.raw(), id) };
        self.scene.geometries.push(geometry);
        id
    }

    /// Adds an instance of another scene, its transform given at motion keys evenly over the shutter and
    /// interpolated linearly between them. Its number is counted with the geometries'.
    ///
    /// # Errors
    /// If that scene holds instances itself (Embree has one level: flatten them first), there are too many keys,
    /// or memory runs out.
    ///
    /// # Panics
    /// If the scene was made with another device.
    pub fn instance(&mut self, scene: Arc<Scene>, world_from_object: &[Affine3A]) -> Result<u32> {
        let keys = world_from_object.len();
        check_key_count(keys)?;
        if scene
            .geometries
            .iter()
            .any(|g| matches!(g.kind, Kind::Instance(_)))
        {
            return Err(Error::failed(
                "instances of instances must be flattened before they are traced",
            ));
        }
        let handle = Handle::new(&self.scene.device, sys::RTC_GEOMETRY_TYPE_INSTANCE)?;
        assert!(
            scene.device.is(&self.scene.device),
            "a scene of another device"
        );
        handle.set_keys(keys);
        // SAFETY: both are alive, and the geometry keeps the scene.
        unsafe { sys::rtcSetGeometryInstancedScene(handle.raw(), scene.handle.0) };
        for (key, transform) in world_from_object.iter().enumerate() {
            let columns = transform.to_cols_array();
            // SAFETY: twelve floats in columns, copied during the call.
            unsafe {
                sys::rtcSetGeometryTransform(
                    handle.raw(),
                    key as u32,
                    sys::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                    columns.as_ptr().cast(),
                );
            }
        }
        handle.commit()?;
        Ok(self.attach(Geometry::from_parts(handle, Kind::Instance(scene), keys)))
    }

    /// Builds the scene on the device's threads. `progress` is told from 0 to 1, from any of these threads, and
    /// stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Memory`] if it does not fit, [`Error::Failed`] if a displacement
    /// or an intersector panicked.
    pub fn commit(mut self, progress: &(dyn Fn(f64) -> bool + Sync)) -> Result<Scene> {
        let scene = &mut self.scene;
        let raw = scene.handle.0;
        let monitor = Progress {
            tell: progress,
            panics: PanicSlot::default(),
        };
        let pointer: *const Progress<'_> = &raw const monitor;
        scene.device.settle();
        // SAFETY: the scene is alive; the monitor outlives the commit, after which Embree forgets it.
        unsafe {
            sys::rtcSetSceneProgressMonitorFunction(
                raw,
                Some(on_progress),
                pointer.cast_mut().cast(),
            );
            sys::rtcCommitScene(raw);
            sys::rtcSetSceneProgressMonitorFunction(raw, None, std::ptr::null_mut());
        }
        let built = scene.device.check();
        let panicked = monitor.panics.take().or_else(|| scene.take_panic());
        if let Some(message) = panicked {
            return Err(Error::failed(format!(
                "panic while a scene was built: {message}"
            )));
        }
        built?;
        let mut b = sys::RTCBounds::default();
        // SAFETY: the scene is alive and committed; one box is written.
        unsafe { sys::rtcGetSceneBounds(raw, &raw mut b) };
        scene.bounds = Bounds3 {
            min: Vec3::new(b.lower_x, b.lower_y, b.lower_z),
            max: Vec3::new(b.upper_x, b.upper_y, b.upper_z),
        };
        for geometry in &scene.geometries {
            geometry.ready.store(true, Ordering::Release);
        }
        Ok(self.scene)
    }
}

impl Scene {
    /// The nearest hit with `ray.t_min < t < ray.t_max`.
    pub fn intersect(&self, ray: &Ray) -> Option<SceneHit> {
        let mut query = Query::new();
        let mut args = sys::rtcInitIntersectArguments();
        let mut both = sys::RTCRayHit {
            ray: raw_ray(ray),
            ..Default::default()
        };
        both.hit.geomID = sys::INVALID_ID;
        both.hit.instID[0] = sys::INVALID_ID;
        let query_pointer = &raw mut query;
        args.context = query_pointer.cast();
        // SAFETY: the scene is committed; ray, arguments and context are ours and live through the call; the
        // context begins the `Query` that the callbacks expect.
        unsafe { sys::rtcIntersect1(self.handle.0, &raw mut both, &raw mut args) };
        let hit = &both.hit;
        if hit.geomID == sys::INVALID_ID {
            return None;
        }
        let instance = (hit.instID[0] != sys::INVALID_ID).then_some(hit.instID[0]);
        let user = query.user.filter(|u| {
            (u.geometry, u.instance, u.primitive, u.t)
                == (hit.geomID, hit.instID[0], hit.primID, both.ray.tfar)
        });
        let home = instance.map_or(self, |i| {
            self.instanced(i).expect("Embree names an instance")
        });
        let normal = Vec3::new(hit.Ng_x, hit.Ng_y, hit.Ng_z);
        Some(SceneHit {
            t: both.ray.tfar,
            uv: Vec2::new(hit.u, hit.v),
            normal: if home.geometry(hit.geomID).flipped {
                -normal
            } else {
                normal
            },
            primitive: hit.primID,
            geometry: hit.geomID,
            instance,
            face: user.map_or(hit.primID, |u| u.face),
            error: user.map_or(0.0, |u| u.error),
        })
    }

    /// Whether anything lies in `ray.t_min < t < ray.t_max`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut query = Query::new();
        let mut args = sys::rtcInitOccludedArguments();
        let query_pointer = &raw mut query;
        args.context = query_pointer.cast();
        let mut raw = raw_ray(ray);
        // SAFETY: as in `intersect`.
        unsafe { sys::rtcOccluded1(self.handle.0, &raw mut raw, &raw mut args) };
        raw.tfar == f32::NEG_INFINITY
    }

    /// The box around everything at all times; empty if there is nothing.
    pub fn bounds(&self) -> Bounds3 {
        self.bounds
    }

    /// The geometry of this number.
    ///
    /// # Panics
    /// If there is none.
    pub fn geometry(&self, id: u32) -> &Geometry {
        &self.geometries[id as usize]
    }

    /// The scene that is instanced under this number, if that is an instance.
    pub fn instanced(&self, id: u32) -> Option<&Arc<Scene>> {
        match &self.geometries.get(id as usize)?.kind {
            Kind::Instance(scene) => Some(scene),
            _ => None,
        }
    }

    /// The message of a panic in one of its intersectors, or in one of an instanced scene; forgotten then.
    pub fn take_panic(&self) -> Option<String> {
        self.geometries.iter().find_map(|g| match &g.kind {
            Kind::Instance(scene) => scene.take_panic(),
            _ => g.panics.take(),
        })
    }
}

/// An owned reference to one of Embree's scenes.
struct SceneHandle(sys::RTCScene);

// SAFETY: a builder changes its scene from the one thread that owns it; a committed scene is never changed, and
// Embree answers queries from any number of threads. What callbacks borrow (intersectors, displacements) is
// Send + Sync by its bounds.
unsafe impl Send for SceneHandle {}
// SAFETY: as above.
unsafe impl Sync for SceneHandle {}

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: our own reference, released once, before the geometries and the device (field order).
        unsafe { sys::rtcReleaseScene(self.0) }
    }
}

/// Embree's context of one query, and behind it what its hit record has no room for.
#[repr(C)]
pub(super) struct Query {
    /// First, as Embree's pointer to it is our pointer to the whole.
    pub(super) context: sys::RTCRayQueryContext,
    /// The latest hit with user geometry, not necessarily the nearest in the end.
    pub(super) user: Option<UserHit>,
}

#[derive(Clone, Copy)]
pub(super) struct UserHit {
    pub(super) geometry: u32,
    pub(super) instance: u32,
    pub(super) primitive: u32,
    pub(super) t: f32,
    pub(super) face: u32,
    pub(super) error: f32,
}

impl Query {
    fn new() -> Self {
        Self {
            context: sys::rtcInitRayQueryContext(),
            user: None,
        }
    }
}

struct Progress<'a> {
    tell: &'a (dyn Fn(f64) -> bool + Sync),
    panics: PanicSlot,
}

unsafe extern "C" fn on_progress(user: *mut c_void, fraction: f64) -> bool {
    // SAFETY: the pointer that `commit` set, whose target outlives the commit.
    let progress = unsafe { &*user.cast::<Progress<'_>>() };
    // Embree counts beyond what it had expected.
    let fraction = fraction.clamp(0.0, 1.0);
    progress.panics.guard(false, || (progress.tell)(fraction))
}

fn raw_ray(ray: &Ray) -> sys::RTCRay {
    sys::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        tnear: ray.t_min,
        dir_x: ray.direction.x,
        dir_y: ray.direction.y,
        dir_z: ray.direction.z,
        time: ray.time,
        tfar: ray.t_max,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}
