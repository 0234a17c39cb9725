//! Images by the cage's texture coordinates.

use relievo::image::{ColorSpace, ImageSource, Texture, Wrap};
use relievo::math::DVec3;
use relievo::surface::{Surface, edge_uv};

use super::models::{cube_sphere, lifted, octahedron_sphere, off};
use super::{bake, displaced, largest, number, points, report};
use crate::common::program::{Bench, expect};

#[test]
fn an_image_is_as_good_by_the_cages_texture_coordinates() {
    let bench = Bench::new();
    bench.write("dense.obj", cube_sphere(80).moved(lifted).obj());
    let (quads, triangles) = (cube_sphere(3), octahedron_sphere(1));
    for (cage, model) in [
        ("catmark_quads.obj", &quads),
        ("catmark_mixed.obj", &triangles),
        ("loop_triangles.obj", &triangles),
    ] {
        bench.write(cage, model.obj_with_islands(0.1));
        let told = report(&bench, &["dense.obj", cage, "-o", "out.exr"]);
        assert_eq!(told["missed"], 0, "{told}");
        let half_a_step = 0.5 * number(&told, "step");
        let surface = displaced(&bench, cage, "out.exr");
        let worst = points(&surface, 24).map(off).fold(0.0, f64::max);
        let borders = borders(&surface).map(off).fold(0.0, f64::max);
        println!(
            "{cage}: {worst:.2e} off, {borders:.2e} at borders, half a step {half_a_step:.2e}"
        );
        assert!(largest(&told) < half_a_step, "{told}");
        assert!(
            worst.max(borders) < half_a_step + 3e-4,
            "{cage}: {worst} {borders}"
        );
    }
    // Beyond islands a few pixels are filled, and then none.
    let arguments = [
        "dense.obj",
        "catmark_quads.obj",
        "-o",
        "out.exr",
        "--texels",
        "512",
    ];
    let filled = |dilation: &str| {
        let more = ["--dilation", dilation, "--type", "f16"];
        report(&bench, &[&arguments[..], &more].concat());
        let image = ImageSource::File(bench.path("out.exr"));
        let image = Texture::load(&image, [Wrap::Clamp; 2], ColorSpace::Raw).expect("an image");
        assert_eq!((image.size(), image.depth()), ([512; 2], 2));
        let pixels = (0..512).flat_map(|y| (0..512).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| image.texel(x, y).x != 0.0).count()
    };
    let [none, some, more] = ["0", "1", "4"].map(filled);
    // 54 squares of 52 pixels a side.
    let around = |rings: usize| 54 * ((52 + 2 * rings).pow(2) - 52 * 52);
    for (count, rings) in [(some, 1), (more, 4)] {
        let ratio = (count - none) as f64 / around(rings) as f64;
        assert!((0.9..1.1).contains(&ratio), "{none} {count} {rings}");
    }
}

/// Places on the borders of faces.
fn borders(surface: &Surface) -> impl Iterator<Item = DVec3> + '_ {
    let places = |face: u32| {
        let along = move |k: u32| (0..24).map(move |i| (face, edge_uv(k, (i as f32 + 0.5) / 24.0)));
        (0..4).flat_map(along)
    };
    (0..surface.base().faces())
        .flat_map(places)
        .map(|(face, uv)| surface.evaluate(face, uv, 0).position.as_dvec3())
}

/// Heights by an atlas, and the cage that was written with it: baked anew for that cage, they are the same.
#[test]
fn a_cage_without_a_layout_gets_an_atlas() {
    let bench = Bench::new();
    bench.write("dense.obj", cube_sphere(20).obj());
    bench.write("bare.obj", cube_sphere(2).obj());
    let by_atlas = [
        "dense.obj",
        "bare.obj",
        "--texels",
        "256",
        "-o",
        "a.exr",
        "--atlas",
        "laid.obj",
    ];
    expect(bake(&bench, &by_atlas), 0, &[]);
    let by_cage = ["dense.obj", "laid.obj", "--texels", "256", "-o", "b.exr"];
    expect(bake(&bench, &by_cage), 0, &[]);
    let [a, b] = ["a.exr", "b.exr"].map(|name| std::fs::read(bench.path(name)).expect("an image"));
    assert!(a == b, "the written cage has another layout");
    let ptex = [
        "dense.obj",
        "bare.obj",
        "-o",
        "a.ptx",
        "--atlas",
        "laid.obj",
    ];
    expect(bake(&bench, &ptex), 2, &["--atlas", ".exr"]);
    // What is read is not written over.
    for cage in ["bare.obj", "dense.obj"] {
        let over = ["dense.obj", "bare.obj", "-o", "c.exr", "--atlas", cage];
        expect(bake(&bench, &over), 2, &[cage, "another name"]);
    }
}

#[test]
fn layouts_that_do_not_fit_are_told() {
    let bench = Bench::new();
    bench.write("dense.obj", cube_sphere(20).obj());
    let model = cube_sphere(2);
    bench.write("bare.obj", model.obj());
    let islands = model.obj_with_islands(0.1);
    bench.write("beyond.obj", islands.replacen("vt 0.02", "vt 1.5", 1));
    let flat = islands.lines().map(|line| match line.starts_with("vt") {
        true => "vt 0.5 0.5\n".to_owned(),
        false => format!("{line}\n"),
    });
    bench.write("flat.obj", flat.collect::<String>());
    let twice = islands.lines().map(|line| match line.strip_prefix("vt ") {
        Some(place) => format!("vt {}\n", place.replace("0.22", "0.02")),
        None => format!("{line}\n"),
    });
    bench.write("twice.obj", twice.collect::<String>());
    let of = |cage: &str| bake(&bench, &["dense.obj", cage, "-o", "out.exr"]);
    expect(
        of("bare.obj"),
        3,
        &["bare.obj", "no texture coordinates", "--atlas"],
    );
    expect(of("beyond.obj"), 3, &["beyond.obj", "face 0", "1.5"]);
    expect(of("flat.obj"), 3, &["flat.obj", "no area"]);
    assert!(!bench.path("out.exr").exists());
    expect(of("twice.obj"), 0, &["more than one face"]);
}
