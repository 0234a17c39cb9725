use super::*;
use crate::error::Error;

fn camera() -> scene::Camera {
    scene::Camera {
        path: "/Camera".into(),
        world_from_camera: vec![DAffine3::IDENTITY],
        projection: Projection::Perspective,
        focal_length: 50.0,
        aperture: Vec2::new(36.0, 24.0),
        aperture_offset: Vec2::ZERO,
        clipping_range: Vec2::new(1.0, 1000.0),
        f_stop: 0.0,
        focus_distance: 0.0,
        shutter: [0.0, 0.0],
        exposure: 0.0,
    }
}

fn options() -> CameraOptions {
    CameraOptions {
        resolution: [300, 200],
        conform: AspectRatioConform::ExpandAperture,
        pixel_aspect: 1.0,
        depth_of_field: true,
    }
}

const MIDDLE: [f32; 2] = [0.5, 0.5];

#[test]
fn the_middle_looks_ahead_and_corners_match_the_aperture() {
    let camera = Camera::new(&camera(), options()).expect("a good camera");
    let ray = camera.ray(Vec2::new(150.0, 100.0), MIDDLE, 0.0);
    assert!((ray.direction - Vec3::NEG_Z).length() < 1e-6);
    assert_eq!(
        (ray.origin, ray.t_min, ray.t_max),
        (Vec3::ZERO, 1.0, 1000.0)
    );
    // Row 0 is the top: up and left.
    let ray = camera.ray(Vec2::ZERO, MIDDLE, 0.0);
    let expected = Vec3::new(-18.0, 12.0, -50.0).normalize();
    assert!((ray.direction - expected).length() < 1e-6);
    // The clipping range counts depth.
    assert!((ray.at(ray.t_min).z + 1.0).abs() < 1e-5);
    assert!((camera.depth(ray.at(ray.t_max), 0.0) - 1000.0).abs() < 1e-2);
}

#[test]
fn apertures_conform() {
    // A square picture, from a film of 36 x 24.
    let at = |conform| {
        let options = CameraOptions {
            resolution: [100, 100],
            conform,
            ..options()
        };
        let camera = Camera::new(&camera(), options).expect("a good camera");
        let size = 50.0 * (camera.window[1] - camera.window[0]);
        (size.round().to_array(), camera.pixel_aspect())
    };
    assert_eq!(at(AspectRatioConform::ExpandAperture), ([36.0, 36.0], 1.0));
    assert_eq!(at(AspectRatioConform::CropAperture), ([24.0, 24.0], 1.0));
    assert_eq!(
        at(AspectRatioConform::AdjustApertureWidth),
        ([24.0, 24.0], 1.0)
    );
    assert_eq!(
        at(AspectRatioConform::AdjustApertureHeight),
        ([36.0, 36.0], 1.0)
    );
    assert_eq!(
        at(AspectRatioConform::AdjustPixelAspectRatio),
        ([36.0, 24.0], 1.5)
    );
}

#[test]
fn offsets_move_the_film() {
    let mut description = camera();
    description.aperture_offset = Vec2::new(5.0, -10.0);
    let camera = Camera::new(&description, options()).expect("a good camera");
    let ray = camera.ray(Vec2::new(150.0, 100.0), MIDDLE, 0.0);
    let expected = Vec3::new(5.0, -10.0, -50.0).normalize();
    assert!((ray.direction - expected).length() < 1e-6);
}

#[test]
fn rays_of_a_lens_meet_where_it_is_sharp() {
    let mut description = camera();
    description.f_stop = 2.0;
    description.focus_distance = 7.0;
    let camera = Camera::new(&description, options()).expect("a good camera");
    let film = Vec2::new(30.0, 150.0);
    // Depth 7 through the pinhole.
    let window = Vec2::new((0.1 - 0.5) * 36.0, (0.5 - 0.75) * 24.0) / 50.0;
    let focus = (7.0 * window).extend(-7.0);
    let mut farthest = 0.0_f32;
    for i in 0..=10 {
        for j in 0..=10 {
            let ray = camera.ray(film, [i as f32 / 10.0, j as f32 / 10.0], 0.0);
            let t = (focus - ray.origin).dot(ray.direction);
            assert!((ray.at(t) - focus).length() < 1e-4);
            farthest = farthest.max(ray.origin.length());
        }
    }
    // 5 units of focal length over f/2: 2.5 across.
    assert!((farthest - 1.25).abs() < 1e-5);
    let sharp = Camera::new(
        &description,
        CameraOptions {
            depth_of_field: false,
            ..options()
        },
    )
    .expect("a good camera");
    assert_eq!(sharp.ray(film, [0.9, 0.1], 0.0).origin, Vec3::ZERO);
}

#[test]
fn parallel_rays() {
    let mut description = camera();
    description.projection = Projection::Orthographic;
    description.aperture = Vec2::new(30.0, 20.0);
    description.clipping_range = Vec2::new(-5.0, 10.0);
    let camera = Camera::new(&description, options()).expect("a good camera");
    let ray = camera.ray(Vec2::ZERO, MIDDLE, 0.0);
    assert_eq!(ray.direction, Vec3::NEG_Z);
    assert!((ray.at(ray.t_min) - Vec3::new(-1.5, 1.0, 5.0)).length() < 1e-6);
    assert!((ray.at(ray.t_max) - Vec3::new(-1.5, 1.0, -10.0)).length() < 1e-6);
}

#[test]
fn a_turning_camera_stays_rigid() {
    let key = |angle: f64, x: f64| {
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(2.0),
            DQuat::from_rotation_y(angle),
            DVec3::new(x, 0.0, 0.0),
        )
    };
    let mut description = camera();
    description.world_from_camera = vec![key(0.0, 0.0), key(2.0, 4.0)];
    let camera = Camera::new(&description, options()).expect("a good camera");
    for (time, expected) in [
        (0.0, key(0.0, 0.0)),
        (0.5, key(1.0, 2.0)),
        (1.0, key(2.0, 4.0)),
    ] {
        let found = camera.world_from_camera(time);
        assert!(found.abs_diff_eq(expected, 1e-12), "{time}: {found:?}");
        let ray = camera.ray(Vec2::new(150.0, 100.0), MIDDLE, time);
        assert!((ray.direction.length() - 1.0).abs() < 1e-6);
        // The clipping range is in the camera's units, twice as long.
        assert!((ray.t_min - 2.0).abs() < 1e-5);
    }
    assert!(camera.moves());
}

#[test]
fn a_mirrored_or_sheared_key_is_kept() {
    let mut sheared = DAffine3::from_rotation_x(0.3);
    sheared.matrix3.x_axis = -sheared.matrix3.x_axis + 0.2 * sheared.matrix3.y_axis;
    let mut description = camera();
    description.world_from_camera = vec![sheared, DAffine3::IDENTITY];
    let camera = Camera::new(&description, options()).expect("a good camera");
    assert!(camera.world_from_camera(0.0).abs_diff_eq(sheared, 1e-12));
}

#[test]
fn matrices_find_the_pixel_again() {
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let mut description = camera();
        description.projection = projection;
        description.aperture_offset = Vec2::new(3.0, 1.0);
        description.world_from_camera = vec![DAffine3::from_rotation_translation(
            DQuat::from_rotation_y(0.7),
            DVec3::new(1.0, 2.0, 3.0),
        )];
        let camera = Camera::new(&description, options()).expect("a good camera");
        let film = Vec2::new(60.0, 40.0);
        let p = camera.ray(film, MIDDLE, 0.0).at(5.0);
        let row_times = |m: [f32; 16]| {
            let v = [p.x, p.y, p.z, 1.0];
            [0, 1, 2, 3].map(|column| (0..4).map(|row| v[row] * m[4 * row + column]).sum::<f32>())
        };
        let ndc = row_times(camera.world_to_ndc());
        assert!((ndc[0] / ndc[3] - 0.2).abs() < 1e-5, "{ndc:?}");
        assert!((ndc[1] / ndc[3] - 0.2).abs() < 1e-5, "{ndc:?}");
        let local = row_times(camera.world_to_camera());
        assert!((local[2] - camera.depth(p, 0.0)).abs() < 1e-5, "{local:?}");
    }
}

#[test]
fn nonsense_is_a_fault_that_names_the_prim() {
    let breaks: [fn(&mut scene::Camera); 7] = [
        |c| c.focal_length = 0.0,
        |c| c.focal_length = f32::NAN,
        |c| c.aperture.x = -1.0,
        |c| c.aperture.y = f32::INFINITY,
        |c| c.clipping_range = Vec2::new(5.0, 5.0),
        |c| c.world_from_camera.clear(),
        |c| c.world_from_camera = vec![DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))],
    ];
    for broken in breaks {
        let mut description = camera();
        broken(&mut description);
        match Camera::new(&description, options()) {
            Err(Error::Input(fault)) => assert_eq!(fault.prim.as_deref(), Some("/Camera")),
            other => panic!("{other:?}"),
        }
    }
}

/// A sphere that a ray of the picture meets is not outside; one far to the side or behind is, the further the more.
#[test]
fn what_is_outside_of_the_picture() {
    use crate::surface::View;
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let mut description = camera();
        description.projection = projection;
        description.aperture_offset = Vec2::new(3.0, -2.0);
        description.world_from_camera = vec![DAffine3::from_rotation_translation(
            DQuat::from_rotation_y(0.7),
            DVec3::new(1.0, 2.0, 3.0),
        )];
        let camera = Camera::new(&description, options()).expect("a good camera");
        for i in 0..100 {
            let film = Vec2::new((i % 10) as f32 * 30.0, (i / 10) as f32 * 20.0);
            let p = camera.ray(film, MIDDLE, 0.0).at(7.0 + i as f32);
            assert!(camera.outside(p, 0.01) < 1e-3, "{film}");
        }
        let to_world = camera.world_from_camera(0.0);
        let at = |x: f64, z: f64| to_world.transform_point3(DVec3::new(x, 0.0, z)).as_vec3();
        let outside = [20.0, 40.0].map(|x| camera.outside(at(x, -10.0), 1.0));
        assert!(0.0 < outside[0] && outside[0] < outside[1], "{outside:?}");
        assert_eq!(camera.outside(at(20.0, -10.0), 30.0), 0.0);
        if projection == Projection::Perspective {
            assert!(camera.outside(at(0.0, 10.0), 1.0) > outside[1]);
        }
    }
}

/// A wide camera that is larger than life, with pixels that are no squares.
#[test]
fn cones_have_the_size_of_pixels() {
    let mut description = camera();
    description.focal_length = 15.0;
    description.world_from_camera = vec![DAffine3::from_scale(DVec3::splat(3.0))];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        description.projection = projection;
        let options = CameraOptions {
            pixel_aspect: 1.5,
            ..options()
        };
        let camera = Camera::new(&description, options).expect("a good camera");
        for film in [[150.0, 100.0], [0.0, 100.0], [290.0, 10.0]].map(Vec2::from) {
            let at = |x: f32, y: f32| camera.ray(film + Vec2::new(x, y), MIDDLE, 0.0).at(20.0);
            let across = (at(2.0, 0.0) - at(-2.0, 0.0)).cross(at(0.0, 2.0) - at(0.0, -2.0));
            let area = across.length() / 16.0;
            let width = camera.cone(film).at(20.0);
            assert!(
                (width * width / area - 1.0).abs() < 2e-3,
                "{film}: {width}, {area}"
            );
        }
    }
}
