//! UsdGeom's shapes without points are the solids that the schema names: on their surface to rounding, facing out.

use std::f64::consts::PI;

use relievo::math::{DVec3, Vec3};
use relievo::nurbs::NurbsSurface;
use relievo::scene::{Geometry, LoadOptions, load};

/// Reads one prim of that type with these attributes.
fn read(type_name: &str, attributes: &str) -> Geometry {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scene.usda");
    let text = format!("#usda 1.0\ndef {type_name} \"Solid\" {{ {attributes} }}\n");
    std::fs::write(&file, text).expect("a file");
    let scene = load(&file, &LoadOptions::default()).expect("a scene");
    scene.shapes[0].geometry.clone()
}

/// Points all over a shape with their normals, and the volume within by the divergence theorem.
fn sampled(geometry: &Geometry) -> (Vec<(DVec3, DVec3)>, f64) {
    let (mut samples, mut volume) = (Vec::new(), 0.0);
    match geometry {
        Geometry::Nurbs(patch) => {
            let surface = NurbsSurface::new(patch).expect("a surface");
            let steps = 64;
            for (v_span, u_span) in (0..(patch.v.count - 1) / 2)
                .flat_map(|v| (0..4).map(move |u| (v as f64, f64::from(u))))
            {
                for i in 0..steps * steps {
                    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(steps);
                    let uv = [u_span + at(i % steps), v_span + at(i / steps)];
                    let point = surface.evaluate(0, uv);
                    let normal = point.du.cross(point.dv);
                    volume += point.position.dot(normal) / f64::from(3 * steps * steps);
                    samples.push((point.position, normal.normalize_or_zero()));
                }
            }
        }
        Geometry::Mesh(mesh) => {
            for corners in mesh.face_vertex_indices.chunks(4) {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| mesh.points[0][corners[i] as usize]);
                let normal = (c - a).cross(d - b).as_dvec3() / 2.0;
                let middle = (a + b + c + d).as_dvec3() / 4.0;
                volume += middle.dot(normal) / 3.0;
                samples.push((middle, normal.normalize()));
            }
        }
    }
    (samples, volume)
}

/// Checks all samples by a signed distance, whose gradient the normals must follow, and the volume.
#[track_caller]
fn is(type_name: &str, attributes: &str, volume: f64, distance: impl Fn(DVec3) -> f64) {
    let (samples, found) = sampled(&read(type_name, attributes));
    for (p, n) in samples {
        let d = distance(p);
        assert!(d.abs() < 1e-6, "{type_name} at {p}: {d} off");
        if n == DVec3::ZERO {
            continue;
        }
        let step = 1e-3;
        let (out, inside) = (distance(p + step * n), distance(p - step * n));
        assert!(
            out > 0.9 * step && inside < -0.9 * step,
            "{type_name} at {p}: normal {n}, {out} and {inside}"
        );
    }
    assert!(
        (found / volume - 1.0).abs() < 2e-3,
        "{type_name}: volume {found} for {volume}"
    );
}

/// The distance to a convex solid in the half plane of (distance from the axis, height): the largest of those to its
/// straight sides, each by a point on it and its outward direction.
fn turned(p: DVec3, axis: usize, sides: &[([f64; 2], [f64; 2])]) -> f64 {
    let height = p[axis];
    let from_axis = (p.length_squared() - height * height).max(0.0).sqrt();
    sides.iter().fold(f64::NEG_INFINITY, |largest, (at, out)| {
        let length = out[0].hypot(out[1]);
        largest.max(((from_axis - at[0]) * out[0] + (height - at[1]) * out[1]) / length)
    })
}

#[test]
fn the_solids_are_what_the_schema_says() {
    is("Sphere", "", 4.0 / 3.0 * PI, |p| p.length() - 1.0);
    is("Sphere", "double radius = 2", 32.0 / 3.0 * PI, |p| {
        p.length() - 2.0
    });
    is("Cube", "double size = 3", 27.0, |p| {
        p.abs().max_element() - 1.5
    });
    let flat = |h: f64| [([0.0, h], [0.0, 1.0]), ([0.0, -h], [0.0, -1.0])];
    for (word, axis) in [("X", 0), ("Y", 1), ("Z", 2)] {
        let attributes =
            format!("double radius = 0.5\ndouble height = 3\nuniform token axis = \"{word}\"");
        is("Cylinder", &attributes, 0.75 * PI, |p| {
            let [top, bottom] = flat(1.5);
            turned(p, axis, &[top, bottom, ([0.5, 0.0], [1.0, 0.0])])
        });
        is("Cone", &attributes, 0.25 * PI, |p| {
            let [_, bottom] = flat(1.5);
            turned(p, axis, &[bottom, ([0.0, 1.5], [3.0, 0.5])])
        });
        is("Capsule", &attributes, 0.75 * PI + PI / 6.0, |p| {
            let nearest = p[axis].clamp(-1.5, 1.5);
            (p - nearest * DVec3::AXES[axis]).length() - 0.5
        });
    }
    let widths = "double radiusBottom = 1\ndouble radiusTop = 0.5\ndouble height = 2";
    is("Cylinder_1", widths, PI * 2.0 / 3.0 * 1.75, |p| {
        let [top, bottom] = flat(1.0);
        turned(p, 2, &[top, bottom, ([1.0, -1.0], [2.0, 0.5])])
    });
    // Two balls and the cone between: sections of the balls and of the cone, cut where they touch.
    let (sine, cap) = (0.25_f64, |r: f64, h: f64| PI * h * h * (r - h / 3.0));
    let cosine = (1.0 - sine * sine).sqrt();
    let (low, high) = (cosine, 0.5 * cosine);
    let frustum = PI / 3.0 * (2.0 - 0.5 * sine) * (low * low + low * high + high * high);
    let volume = cap(1.0, 1.0 + sine) + frustum + cap(0.5, 0.5 * (1.0 - sine));
    is("Capsule_1", widths, volume, |p| {
        let from_axis = p.truncate().length();
        // Along the cone's normal back to the axis.
        let along = p.z - from_axis * sine / cosine;
        let [at, radius] = if along < -1.0 {
            [-1.0, 1.0]
        } else if along > 1.0 {
            [1.0, 0.5]
        } else {
            return from_axis * cosine + (p.z + 1.0) * sine - 1.0;
        };
        from_axis.hypot(p.z - at) - radius
    });
}

#[test]
fn one_ball_is_left_where_it_holds_the_other() {
    let attributes = "double radiusBottom = 2\ndouble radiusTop = 0.5\ndouble height = 1";
    is("Capsule_1", attributes, 32.0 / 3.0 * PI, |p| {
        (p + DVec3::new(0.0, 0.0, 0.5)).length() - 2.0
    });
    is("Capsule", "double height = 0", PI / 6.0, |p| {
        p.length() - 0.5
    });
}

#[test]
fn planes_face_along_their_axis() {
    for (axis, normal, extent) in [
        ("X", Vec3::X, Vec3::new(0.0, 3.0, 2.0)),
        ("Y", Vec3::Y, Vec3::new(2.0, 0.0, 3.0)),
        ("Z", Vec3::Z, Vec3::new(2.0, 3.0, 0.0)),
    ] {
        let attributes = format!("double length = 3\nuniform token axis = \"{axis}\"");
        let plane = read("Plane", &attributes);
        assert_eq!(plane.bounds().extent(), extent);
        assert_eq!(sampled(&plane).0, [(DVec3::ZERO, normal.as_dvec3())]);
    }
}
