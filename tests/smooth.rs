//! Facets that stand for a smooth surface are shaded like it.

use std::f32::consts::PI;

use crate::common::{ball, options, read, run, write_scene};
use relievo::math::Vec3;

/// Looks along -Z at the square -1..1; a parallel light from the right, 70° off the view.
const STAGE: &str = r#"
def Camera "Camera" {
    token projection = "orthographic"
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.001, 1000)
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Light" {
    float inputs:angle = 0
    float inputs:intensity = 2
    float xformOp:rotateY = 70
    uniform token[] xformOpOrder = ["xformOp:rotateY"]
}
"#;

/// A ball of few quads with normals in its vertices looks like a ball: its shadow begins where the ball's does,
/// not along the facets' edges.
#[test]
fn a_coarse_ball_with_normals_has_the_shadow_of_a_ball() {
    let folder = tempfile::tempdir().expect("a folder");
    let attributes = "color3f[] primvars:displayColor = [(1, 1, 1)]";
    let body = ball(1.0, 12, false, true, attributes);
    let scene = write_scene(folder.path(), "ball.usda", &format!("{STAGE}{body}"));
    let picture = folder.path().join("ball.exr");
    let mut options = options(&scene, &picture);
    options.resolution = Some([64, 64]);
    run(&options);
    let (width, _, pixels) = read(&picture);
    let light = Vec3::new(70_f32.to_radians().sin(), 0.0, 70_f32.to_radians().cos());
    let (mut worst, mut sum, mut count) = (0.0_f32, 0.0, 0);
    for (i, pixel) in pixels.iter().enumerate() {
        let across = |k: u32| (2 * k + 1) as f32 / width as f32 - 1.0;
        let (x, y) = (across(i as u32 % width), -across(i as u32 / width));
        let r2 = x * x + y * y;
        // Nearer to the outline the coarse ball has none of the ball's points.
        if r2 > 0.8 {
            continue;
        }
        let normal = Vec3::new(x, y, (1.0 - r2).sqrt());
        let off = (pixel.x - 2.0 / PI * normal.dot(light).max(0.0)).abs();
        worst = worst.max(off);
        sum += off;
        count += 1;
    }
    let mean = sum / count as f32;
    println!("off by {mean} on average, {worst} at most");
    assert!(mean < 0.002 && worst < 0.01, "{mean} {worst}");
}
