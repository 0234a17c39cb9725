//! Scenes whose radiance is known.

use crate::common::{cube, mean, options, read, run, write_scene};
use relievo::integrate::PathOptions;
use relievo::math::Vec3;

const CAMERA: &str = r#"
def Camera "Camera" {
    float focalLength = 50
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.001, 1000)
    double3 xformOp:translate = (0, 0, 6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"#;

/// How many times as long micro-edges are after a bounce. Inside of the room what is diced more coarsely lies in front of
/// the surface; around the ball it lies behind it.
const BOUNCE_DICING: [Option<f32>; 2] = [None, Some(8.0)];

/// A closed room that emits `E` and reflects `a` shows `E (1 + a + … + a^n)` everywhere after `n` scatterings.
#[test]
fn a_closed_glowing_room() {
    let folder = tempfile::tempdir().expect("a folder");
    let kinds = [(0.5, 6), (1.0, 4)].map(|kind| BOUNCE_DICING.map(|times| (kind, times)));
    for ((albedo, bounces), bounce_dicing) in kinds.into_iter().flatten() {
        let material = format!(
            r#"
def Material "Glow" {{
    token outputs:surface.connect = </Glow/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = ({albedo}, {albedo}, {albedo})
        color3f inputs:emissiveColor = (0.25, 0.5, 1)
        float inputs:ior = 1
        token outputs:surface
    }}
}}
"#
        );
        let room = cube("Room", 8.0, true, false, "rel material:binding = </Glow>");
        let scene = write_scene(
            folder.path(),
            "room.usda",
            &format!("{CAMERA}{material}{room}"),
        );
        let picture = folder.path().join("room.exr");
        let mut options = options(&scene, &picture);
        options.spp = 256;
        options.resolution = Some([16, 16]);
        options.build.bounce_dicing = bounce_dicing;
        options.path = PathOptions {
            max_bounces: bounces,
            ..PathOptions::default()
        };
        run(&options);
        let expected: f32 = (0..=bounces).map(|n| f32::powi(albedo, n as i32)).sum();
        let got = mean(&read(&picture).2) / Vec3::new(0.25, 0.5, 1.0);
        // The default dome lights a scene without lights: none of it may come in.
        assert!(
            (got / expected - Vec3::ONE).abs().max_element() < 2e-3,
            "albedo {albedo}, {bounce_dicing:?}: {got} for {expected}"
        );
    }
}

/// A convex Lambert body under a dome of radiance 1 shows its albedo.
#[test]
fn a_ball_under_a_dome() {
    let folder = tempfile::tempdir().expect("a folder");
    let kinds = [0.5, 1.0].map(|albedo| BOUNCE_DICING.map(|times| (albedo, times)));
    for (albedo, bounce_dicing) in kinds.into_iter().flatten() {
        let ball = cube(
            "Ball",
            3.0,
            false,
            false,
            &format!("color3f[] primvars:displayColor = [({albedo}, {albedo}, {albedo})]"),
        );
        let dome = "def DomeLight \"Dome\" { float inputs:intensity = 1 }\n";
        let scene = write_scene(folder.path(), "ball.usda", &format!("{CAMERA}{ball}{dome}"));
        let picture = folder.path().join("ball.exr");
        let mut options = options(&scene, &picture);
        options.spp = 256;
        options.resolution = Some([32, 32]);
        options.build.bounce_dicing = bounce_dicing;
        run(&options);
        let (width, height, pixels) = read(&picture);
        let middle: Vec<Vec3> = pixels
            .iter()
            .enumerate()
            .filter(|(i, _)| {
                let (x, y) = (*i as u32 % width, *i as u32 / width);
                x > width / 4 && x < 3 * width / 4 && y > height / 4 && y < 3 * height / 4
            })
            .map(|(_, p)| *p)
            .collect();
        let got = mean(&middle);
        assert!(
            (got / albedo - Vec3::ONE).abs().max_element() < 2e-3,
            "albedo {albedo}, {bounce_dicing:?}: {got}"
        );
    }
}
