//! Every kind of light in whole pictures whose radiance has a closed form.
//!
//! Three beliefs. A floor under one light shows albedo / π times its irradiance, which Lambert's contour formula
//! gives for any polygon. A closed room in which walls and lights are as bright as a black body of one
//! temperature looks the same everywhere, whatever its shape. And a hollow ball around a ball-shaped light mixes
//! light so evenly that each scattering adds one term of a geometric series.

use std::f64::consts::PI;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec2, DVec3, EulerRot, dvec2, dvec3};

use crate::common::{ball, cube, mean, options, read, run, write_scene};
use relievo::image::{Channel, ChannelFormat, Compression, Part, Picture, write_exr};
use relievo::integrate::PathOptions;
use relievo::math::Vec3;

/// What the pictures may be off by, at [`SPP`].
const TOLERANCE: f64 = 2e-3;
const SPP: u32 = 256;

/// Renders without Russian roulette, and gives the pixels.
fn picture(scene: &Path, size: u32, bounces: u32) -> Vec<Vec3> {
    let picture = scene.with_extension("exr");
    let mut options = options(scene, &picture);
    options.spp = SPP;
    options.resolution = Some([size, size]);
    options.path = PathOptions {
        max_bounces: bounces,
        roulette_after: bounces,
        ..PathOptions::default()
    };
    run(&options);
    read(&picture).2
}

// ---- A floor under a light -----------------------------------------------------------------------------------

/// Looks straight down at the square -1..1 from a height of 0.5, below all the lights: x to the right, z down.
const ABOVE: &str = r#"
def Camera "Camera" {
    token projection = "orthographic"
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.001, 1000)
    float xformOp:rotateX = -90
    double3 xformOp:translate = (0, 0.5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
"#;

fn floor(albedo: f64) -> String {
    format!(
        r#"
def Mesh "Floor" {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
    uniform token subdivisionScheme = "none"
    color3f[] primvars:displayColor = [({albedo}, {albedo}, {albedo})]
}}
"#
    )
}

/// USD's text for a transform; its matrices have the axes in rows.
fn transform(world_from_light: &DAffine3) -> String {
    let m = world_from_light.matrix3;
    let t = world_from_light.translation;
    let row = |v: DVec3, w: f64| format!("({}, {}, {}, {w})", v.x, v.y, v.z);
    format!(
        "matrix4d xformOp:transform = ({}, {}, {}, {})\n\
         uniform token[] xformOpOrder = [\"xformOp:transform\"]",
        row(m.x_axis, 0.0),
        row(m.y_axis, 0.0),
        row(m.z_axis, 0.0),
        row(t, 1.0)
    )
}

/// A place above the floor for a light that shines down, but for some degrees of tilt.
fn placed(at: DVec3, tilt: [f64; 3], scale: DVec3) -> DAffine3 {
    let [x, y, z] = tilt.map(f64::to_radians);
    let down = DMat3::from_rotation_x(-0.5 * PI);
    let turned = DMat3::from_euler(EulerRot::XYZ, x, y, z);
    DAffine3 {
        matrix3: turned * down * DMat3::from_diagonal(scale),
        translation: at,
    }
}

/// Lambert's formula: the irradiance at `p`, facing up, from a surface of radiance 1 whose border, as seen from
/// there, is the polygon; all of it above the horizon.
fn contour(p: DVec3, polygon: &[DVec3]) -> f64 {
    let sum: f64 = polygon
        .iter()
        .zip(polygon.iter().cycle().skip(1))
        .map(|(a, b)| {
            let (a, b) = (*a - p, *b - p);
            assert!(a.y > 0.0 && b.y > 0.0, "below the horizon");
            let across = a.cross(b);
            across.length().atan2(a.dot(b)) * across.normalize_or_zero().y
        })
        .sum();
    0.5 * sum.abs()
}

const ARC: usize = 512;

fn turns(from: f64, to: f64) -> impl DoubleEndedIterator<Item = f64> {
    (0..=ARC).map(move |i| from + (to - from) * i as f64 / ARC as f64)
}

fn rectangle(world_from_light: &DAffine3, [w, h]: [f64; 2]) -> Vec<DVec3> {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| world_from_light.transform_point3(dvec3(0.5 * w * x, 0.5 * h * y, 0.0)))
        .to_vec()
}

fn disk(world_from_light: &DAffine3, radius: f64) -> Vec<DVec3> {
    turns(0.0, 2.0 * PI)
        .map(|a| world_from_light.transform_point3(radius * dvec3(a.cos(), a.sin(), 0.0)))
        .collect()
}

/// The border of the outside of a tube along X, as far as it faces `p`.
fn tube(p: DVec3, world_from_light: &DAffine3, radius: f64, length: f64) -> Vec<DVec3> {
    let from = world_from_light.inverse().transform_point3(p);
    let towards = from.z.atan2(from.y);
    let half = (radius / from.z.hypot(from.y)).acos();
    let at = |x: f64| {
        move |a: f64| {
            world_from_light.transform_point3(dvec3(x, radius * a.cos(), radius * a.sin()))
        }
    };
    turns(towards - half, towards + half)
        .map(at(0.5 * length))
        .chain(
            turns(towards - half, towards + half)
                .rev()
                .map(at(-0.5 * length)),
        )
        .collect()
}

/// Bilinear between the centres of 4 × 4 texels, rows from the top; `s` to the right, `t` up, both 0..1.
fn bilinear(texels: &[[f64; 4]; 4], s: f64, t: f64, around: bool) -> f64 {
    let (x, y) = (4.0 * s - 0.5, 4.0 * (1.0 - t) - 0.5);
    let column = |x: f64| match around {
        true => x.rem_euclid(4.0) as usize,
        false => x.clamp(0.0, 3.0) as usize,
    };
    let row = |y: f64| &texels[y.clamp(0.0, 3.0) as usize];
    let blend = |y: f64| {
        let (a, b) = (row(y)[column(x.floor())], row(y)[column(x.floor() + 1.0)]);
        a + (x - x.floor()) * (b - a)
    };
    blend(y.floor()) + (y - y.floor()) * (blend(y.floor() + 1.0) - blend(y.floor()))
}

const TEXELS: [[f64; 4]; 4] = [
    [0.5, 4.0, 1.0, 0.25],
    [2.0, 0.0, 3.0, 1.5],
    [1.0, 0.75, 8.0, 0.0],
    [0.0, 2.5, 0.5, 6.0],
];

fn write_texels(path: &Path) {
    let channels = ["R", "G", "B"].map(|name| Channel {
        name: name.into(),
        format: ChannelFormat::Float,
    });
    write_exr(
        path,
        &Picture {
            width: 4,
            height: 4,
            display_window: (4, 4, 0, 0),
            parts: vec![Part {
                name: String::new(),
                channels: channels.to_vec(),
                pixels: TEXELS
                    .as_flattened()
                    .iter()
                    .flat_map(|&v| [v as f32; 3])
                    .collect(),
            }],
            metadata: Vec::new(),
            tile: None,
            compression: Compression::Zip,
        },
    )
    .expect("written");
}

/// A textured rectangle's irradiance, by the midpoint rule. Whoever stands in its light sees s = 0 at its +X.
fn textured_rectangle(p: DVec3, world_from_light: &DAffine3, [w, h]: [f64; 2]) -> f64 {
    const N: usize = 48;
    let front = -world_from_light.matrix3.z_axis.normalize();
    let mut sum = 0.0;
    for i in 0..N {
        for j in 0..N {
            let (u, v) = ((i as f64 + 0.5) / N as f64, (j as f64 + 0.5) / N as f64);
            let at = world_from_light.transform_point3(dvec3(w * (u - 0.5), h * (v - 0.5), 0.0));
            let to = at - p;
            let cosines = to.y * -to.dot(front) / to.length_squared();
            let texel = bilinear(&TEXELS, 1.0 - u, v, false);
            sum += texel * cosines / to.length_squared();
        }
    }
    sum * w * h / (N * N) as f64
}

/// A textured dome's irradiance on what faces up: turned about the vertical it stays the same, so that only the
/// means of the rows count.
fn textured_dome() -> f64 {
    const N: usize = 20_000;
    let rows = TEXELS.map(|row| [row.iter().sum::<f64>() / 4.0; 4]);
    (0..N)
        .map(|i| 0.5 * PI * (i as f64 + 0.5) / N as f64)
        .map(|down| bilinear(&rows, 0.5, 1.0 - down / PI, true) * down.sin() * down.cos())
        .sum::<f64>()
        * 2.0
        * PI
        * 0.5
        * PI
        / N as f64
}

struct Light {
    name: &'static str,
    text: String,
    irradiance: Box<dyn Fn(DVec3) -> f64>,
}

fn light(
    name: &'static str,
    kind: &str,
    inputs: &str,
    world_from_light: DAffine3,
    irradiance: impl Fn(DVec3, &DAffine3) -> f64 + 'static,
) -> Light {
    Light {
        name,
        text: format!(
            "def {kind} \"Light\" {{\n{inputs}\n{}\n}}\n",
            transform(&world_from_light)
        ),
        irradiance: Box::new(move |p| irradiance(p, &world_from_light)),
    }
}

fn lights() -> Vec<Light> {
    let straight = |y: f64| placed(dvec3(0.3, y, -0.2), [0.0; 3], DVec3::ONE);
    let tilted = |y: f64| placed(dvec3(0.2, y, 0.3), [20.0, 35.0, -15.0], DVec3::ONE);
    let stretched = placed(
        dvec3(0.1, 2.0, 0.0),
        [15.0, 20.0, 0.0],
        dvec3(1.5, 0.6, 1.0),
    );
    let size = "float inputs:width = 1.5\nfloat inputs:height = 0.8";
    let textured = format!("{size}\nasset inputs:texture:file = @./texels.exr@");
    vec![
        light("rect", "RectLight", size, straight(1.0), |p, m| {
            contour(p, &rectangle(m, [1.5, 0.8]))
        }),
        light("tilted rect", "RectLight", size, tilted(1.5), |p, m| {
            contour(p, &rectangle(m, [1.5, 0.8]))
        }),
        light(
            "textured rect",
            "RectLight",
            &textured,
            tilted(1.5),
            |p, m| textured_rectangle(p, m, [1.5, 0.8]),
        ),
        light(
            "disk",
            "DiskLight",
            "float inputs:radius = 0.6",
            straight(1.0),
            |p, m| contour(p, &disk(m, 0.6)),
        ),
        light(
            "elliptic disk",
            "DiskLight",
            "float inputs:radius = 0.6",
            stretched,
            |p, m| contour(p, &disk(m, 0.6)),
        ),
        light(
            "sphere",
            "SphereLight",
            "float inputs:radius = 0.4",
            straight(1.2),
            |p, m| {
                let to = m.translation - p;
                PI * 0.4 * 0.4 * to.y / to.length().powi(3)
            },
        ),
        light(
            "cylinder",
            "CylinderLight",
            "float inputs:radius = 0.25\nfloat inputs:length = 1.5",
            tilted(1.5),
            |p, m| contour(p, &tube(p, m, 0.25, 1.5)),
        ),
        light(
            "sun",
            "DistantLight",
            "float inputs:angle = 0.53\nfloat inputs:intensity = 2\nbool inputs:normalize = true",
            tilted(1.0),
            |_, m| 2.0 * m.matrix3.z_axis.y,
        ),
        light(
            "parallel light",
            "DistantLight",
            "float inputs:angle = 0\nfloat inputs:intensity = 2",
            tilted(1.0),
            |_, m| 2.0 * m.matrix3.z_axis.y,
        ),
        light(
            "wide cone",
            "DistantLight",
            "float inputs:angle = 70\nfloat inputs:intensity = 1",
            tilted(1.0),
            |_, m| PI * 35_f64.to_radians().sin().powi(2) * m.matrix3.z_axis.y,
        ),
        light("dome", "DomeLight", "", DAffine3::IDENTITY, |_, _| PI),
        light(
            "textured dome",
            "DomeLight",
            "asset inputs:texture:file = @./texels.exr@",
            DAffine3::from_rotation_y(0.4),
            |_, _| textured_dome(),
        ),
    ]
}

#[test]
fn a_floor_under_each_light_shows_its_irradiance() {
    let folder = tempfile::tempdir().expect("a folder");
    write_texels(&folder.path().join("texels.exr"));
    const SIZE: u32 = 32;
    /// Points across a pixel, for its mean.
    const FINE: u32 = 2;
    for light in lights() {
        let n = SIZE * FINE;
        let across = |i: u32| (2 * i + 1) as f64 / n as f64 - 1.0;
        let points: Vec<DVec2> = (0..n * n)
            .map(|i| dvec2(across(i % n), across(i / n)))
            .collect();
        let irradiance = |p: &DVec2| (light.irradiance)(dvec3(p.x, 0.0, p.y));
        let fine: Vec<f64> = points.iter().map(irradiance).collect();
        let pixel = |i: u32| -> f64 {
            let (x, y) = (FINE * (i % SIZE), FINE * (i / SIZE));
            let part = (0..FINE * FINE).map(|k| (y + k / FINE) * n + x + k % FINE);
            part.map(|k| fine[k as usize]).sum::<f64>() / f64::from(FINE * FINE)
        };
        for albedo in [0.5, 1.0] {
            let scene = format!("{ABOVE}{}{}", floor(albedo), light.text);
            let scene = write_scene(folder.path(), "floor.usda", &scene);
            let pixels = picture(&scene, SIZE, 1);
            let expected: Vec<f64> = (0..SIZE * SIZE).map(|i| albedo / PI * pixel(i)).collect();
            let whole = expected.iter().sum::<f64>() / expected.len() as f64;
            let off = f64::from(mean(&pixels).x) / whole - 1.0;
            // Where it is bright, and where it is dark: light that falls on the wrong side shows here.
            let apart = pixels
                .iter()
                .zip(&expected)
                .map(|(p, e)| (f64::from(p.x) - e).abs())
                .sum::<f64>()
                / expected.len() as f64
                / whole;
            println!(
                "{}, albedo {albedo}: mean {:+.3} %, pixels {:.2} %",
                light.name,
                100.0 * off,
                100.0 * apart
            );
            assert!(off.abs() < TOLERANCE, "{}: {off}", light.name);
            assert!(apart < 0.03, "{}: {apart}", light.name);
        }
    }
}

// ---- A room at one temperature -------------------------------------------------------------------------------

/// In the room's middle height, near a corner, looking to the far one.
const INSIDE: &str = r#"
def Camera "Camera" {
    float focalLength = 15
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.001, 1000)
    float xformOp:rotateY = 45
    double3 xformOp:translate = (3.8, -1, 3.8)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
}
"#;

const RADIANCE: f32 = 2.0;

/// Walls that shine (1 - a) of the radiance and reflect a.
fn walls(albedo: f32) -> String {
    let glow = RADIANCE * (1.0 - albedo);
    format!(
        r#"
def Material "Wall" {{
    token outputs:surface.connect = </Wall/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = ({albedo}, {albedo}, {albedo})
        color3f inputs:emissiveColor = ({glow}, {glow}, {glow})
        float inputs:ior = 1
        token outputs:surface
    }}
}}
"#
    )
}

/// A light of the radiance in a closed room looks like the walls, and so does an opening through which a light
/// outside shines: everywhere in the room is the same radiance. What a limit of n scatterings leaves out is the
/// light that has met walls only, more than n times: at most `a^(n + 1)`, and less as the lights take part of it.
#[test]
fn a_room_at_one_temperature_shows_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let down = |y: f64| transform(&placed(dvec3(0.0, y, 0.0), [0.0; 3], DVec3::ONE));
    let rooms = [
        // The light is the ceiling.
        (
            "RectLight",
            true,
            "float inputs:width = 8.1\nfloat inputs:height = 8.1",
            down(3.999),
        ),
        ("DiskLight", true, "float inputs:radius = 6", down(3.999)),
        // The light stands in the room.
        ("SphereLight", false, "float inputs:radius = 2.4", down(0.7)),
        // A tube through two walls: its open ends are outside.
        (
            "CylinderLight",
            false,
            "float inputs:radius = 1.8\nfloat inputs:length = 9",
            down(0.5),
        ),
        // The room has no ceiling.
        ("DistantLight", true, "float inputs:angle = 180", down(0.0)),
        ("DomeLight", true, "", String::new()),
    ];
    let attributes = "rel material:binding = </Wall>\nuniform token subdivisionScheme = \"none\"";
    for (kind, open, inputs, place) in rooms {
        for (albedo, bounces) in [(0.5, 12), (1.0, 80)] {
            let light = format!(
                "def {kind} \"Light\" {{ float inputs:intensity = {RADIANCE}\n{inputs}\n{place}\n}}\n"
            );
            let room = cube("Room", 4.0, true, open, attributes);
            let scene = format!("{INSIDE}{}{room}{light}", walls(albedo));
            let scene = write_scene(folder.path(), "room.usda", &scene);
            let pixels = picture(&scene, 48, bounces);
            let off = f64::from(mean(&pixels).x / RADIANCE - 1.0);
            println!("{kind}, albedo {albedo}: mean {:+.3} %", 100.0 * off);
            assert!(off.abs() < TOLERANCE, "{kind}, albedo {albedo}: {off}");
        }
    }
}

// ---- A hollow ball around a light ----------------------------------------------------------------------------

/// The wall of a ball of radius R around a light of radius r and radiance L has the same irradiance everywhere:
/// π L q, with q = r²/R² the light's share of what any point of the wall sees, by the cosine. After n scatterings
/// it therefore shows `a q L` times the sum of `(a (1 - q))^k` for k from 0 to n - 1: the light takes what meets it.
#[test]
fn a_hollow_ball_sums_a_series() {
    let folder = tempfile::tempdir().expect("a folder");
    // Away from the light, so that only the wall is seen.
    let camera = INSIDE
        .replace("rotateY = 45", "rotateY = 180")
        .replace("(3.8, -1, 3.8)", "(0.5, 0.2, 2)");
    let light = "def SphereLight \"Light\" { float inputs:radius = 1 }\n";
    for (albedo, bounces) in [(0.5_f32, 1), (0.5, 6), (1.0, 2), (1.0, 12)] {
        let color = format!("color3f[] primvars:displayColor = [({albedo}, {albedo}, {albedo})]");
        let hollow = ball(4.0, 96, true, false, &color);
        let scene = format!("{camera}{hollow}{light}");
        let scene = write_scene(folder.path(), "ball.usda", &scene);
        let pixels = picture(&scene, 16, bounces);
        let (a, q) = (f64::from(albedo), 1.0 / 16.0);
        let series: f64 = (0..bounces).map(|k| (a * (1.0 - q)).powi(k as i32)).sum();
        let off = f64::from(mean(&pixels).x) / (a * q * series) - 1.0;
        println!(
            "albedo {albedo}, {bounces} scatterings: {:+.3} %",
            100.0 * off
        );
        assert!(off.abs() < TOLERANCE, "albedo {albedo}, {bounces}: {off}");
    }
}
