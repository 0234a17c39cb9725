//! Any bytes as a control mesh: what passes the checks is triangulated, refined, handed to Embree and hit by rays.
#![no_main]

use std::sync::Arc;

use relievo::math::{Cone, DAffine3, DVec3, Ray, Vec2, Vec3};
use relievo::mesh::{BoundaryInterpolation, ControlMesh, Corner, Crease, Interpolation, Primvar, Scheme, triangulate};
use relievo::scene::{AspectRatioConform, Binding, Camera, Description, Geometry, Placement, Projection, Shape};
use relievo::shade::camera::{Camera as Prepared, CameraOptions};
use relievo::subdiv::{LimitSurface, refine};
use relievo::trace::{Device, DeviceOptions};
use relievo::world::{BuildOptions, Detail, Dicing, Met, World};

thread_local! {
    static DEVICE: Device = Device::new(&DeviceOptions { threads: 1, ..DeviceOptions::default() }).expect("a device");
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mesh = mesh(bytes);
    if mesh.validate().is_err() {
        return;
    }
    let _ = mesh.repeated_corner();
    let _ = triangulate(&mesh);
    subdivide(&mesh);
    trace(mesh);
});

/// Refines the mesh, and evaluates its limit surface at and near corners and edges and within the faces.
fn subdivide(mesh: &ControlMesh) {
    let refined = refine(mesh, 1);
    refined.mesh.validate().expect("a refined mesh is valid");
    let surface = LimitSurface::new(mesh);
    let points = surface.points::<f64>(mesh, 0);
    for face in (0..surface.face_count() as u32).filter(|&f| !surface.is_hole(f)) {
        for [u, v] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1e-9, 1e-12], [0.5, 0.0], [0.3, 0.6], [f64::NAN, 2.0]] {
            let point = surface.evaluate(&points, face, u, v);
            assert!(point.position.iter().all(|x| x.is_finite()), "face {face} at {u} {v}");
            let _ = surface.isolate(&points, face, u, v, 10);
        }
    }
}

/// Small numbers from the bytes, most of them of some use.
fn mesh(bytes: &[u8]) -> ControlMesh {
    let mut bytes = bytes.iter().copied();
    let mut byte = || bytes.next().unwrap_or_default();
    let scheme = [Scheme::CatmullClark, Scheme::Loop, Scheme::Bilinear, Scheme::None][usize::from(byte() % 4)];
    let triangles = scheme == Scheme::Loop;
    let boundary = [
        BoundaryInterpolation::None,
        BoundaryInterpolation::EdgeOnly,
        BoundaryInterpolation::EdgeAndCorner,
    ][usize::from(byte() % 3)];
    let mut mesh = ControlMesh {
        scheme,
        boundary,
        left_handed: byte() % 2 == 0,
        ..ControlMesh::default()
    };
    let count = byte() % 32;
    let points = (0..count).map(|_| Vec3::new(byte().into(), byte().into(), byte().into()));
    mesh.points = vec![points.collect()];
    for _ in 0..byte() % 32 {
        let corners = if triangles { 3 } else { byte() % 20 };
        mesh.face_vertex_counts.push(corners.into());
        mesh.face_vertex_indices.extend((0..corners).map(|_| u32::from(byte() % count.max(1))));
    }
    for _ in 0..byte() % 8 {
        mesh.creases.push(Crease {
            vertices: [(byte() % 33).into(), (byte() % 33).into()],
            sharpness: f32::from(byte()) / 20.0,
        });
        mesh.corners.push(Corner {
            vertex: (byte() % 33).into(),
            sharpness: f32::from(byte()) / 20.0,
        });
        mesh.holes.push((byte() % 33).into());
    }
    if byte() % 2 == 0 {
        let corners = mesh.face_vertex_indices.len();
        mesh.primvars.push(Primvar {
            name: "displayColor".into(),
            interpolation: Interpolation::FaceVarying,
            width: 3,
            values: (0..3 * 8).map(|_| byte().into()).collect(),
            indices: Some((0..corners).map(|_| u32::from(byte() % 9)).collect()),
        });
    }
    mesh
}

/// A world of one mesh: bad input may be refused, a hit must be finite.
fn trace(mesh: ControlMesh) {
    let camera = Camera {
        path: "/Camera".into(),
        world_from_camera: vec![DAffine3::from_translation(DVec3::new(128.0, 128.0, 1000.0))],
        projection: Projection::Perspective,
        focal_length: 50.0,
        aperture: Vec2::splat(20.0),
        aperture_offset: Vec2::ZERO,
        clipping_range: Vec2::new(0.1, 1e6),
        f_stop: 0.0,
        focus_distance: 0.0,
        shutter: [0.0; 2],
        exposure: 0.0,
    };
    let options = CameraOptions {
        resolution: [8, 8],
        conform: AspectRatioConform::ExpandAperture,
        pixel_aspect: 1.0,
        depth_of_field: false,
    };
    let prepared = Prepared::new(&camera, options).expect("a camera");
    let description = Description {
        cameras: vec![camera],
        shapes: vec![Shape {
            path: "/Mesh".into(),
            geometry: Geometry::Mesh(Arc::new(mesh)),
            materials: Binding::default(),
            double_sided: true,
            unusable_primvars: Vec::new(),
            tiles: None,
        }],
        placements: vec![Placement {
            path: "/Mesh".into(),
            shape: 0,
            world_from_object: vec![DAffine3::IDENTITY],
            display_color: None,
            material: None,
        }],
        ..Description::default()
    };
    let build = BuildOptions {
        dicing: Dicing { max_segments: 4, ..Dicing::default() },
        default_dome: 1.0,
        ..BuildOptions::default()
    };
    let built = DEVICE.with(|device| World::build(&description, &prepared, device, &build, &|_| true));
    let Ok(built) = built else {
        return;
    };
    for i in 0..16 {
        let (x, y) = ((i % 4 * 70 + 20) as f32, (i / 4 * 70 + 20) as f32);
        let ray = Ray::new(Vec3::new(x, y, 1000.0), Vec3::new(0.01, -0.02, -1.0), 0.0);
        if let Met::Surface(hit) = built.world.meet(&ray, Cone::LINE, Detail::Full) {
            assert!(hit.position.is_finite() && hit.shading_normal.is_finite(), "{ray:?}");
            assert!((hit.face as usize) < description.shapes[0].geometry.face_count());
        }
    }
    assert_eq!(built.world.take_panic(), None);
}
