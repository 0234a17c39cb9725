//! `relievo atlas`, and what its seams do to a texture.

use std::path::Path;

use relievo::atlas::{AtlasOptions, atlas};
use relievo::image::{
    ColorSpace, ImageSource, PtexFilter, PtexOptions, PtexTexture, Texture, Wrap,
};
use relievo::math::{Area, Vec2, Vec3};
use relievo::mesh::{
    ControlMesh, FaceVaryingInterpolation, Primvar, PtexFace, Scheme, Topology, ptex_faces,
};
use relievo::scene::{Geometry, LoadOptions, load};
use relievo_ptex::Cache;

use crate::common::program::{Bench, expect, said};
use crate::common::shared;

const CUBE: &str = "v -1 -1 -1\nv 1 -1 -1\nv 1 -1 1\nv -1 -1 1\nv -1 1 -1\nv 1 1 -1\nv 1 1 1\nv -1 1 1\n\
                    f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n\
                    t crease 2/1/0 0 1 2.5\nt corner 1/1/0 6 3\nt hole 1/0/0 2\n";

fn run(bench: &Bench, arguments: &str) -> (i32, String) {
    let words: Vec<&str> = ["atlas"].into_iter().chain(arguments.split(' ')).collect();
    said(&bench.command(&words).output().expect("the program runs"))
}

/// The mesh of a file whose path ends so, which must be read without a warning.
fn mesh_of(path: &Path, ending: &str) -> ControlMesh {
    let scene = load(path, &LoadOptions::default()).expect("a scene");
    let said: Vec<_> = scene.warnings.iter().map(|w| &w.message).collect();
    assert!(said.is_empty(), "{said:?}");
    let mesh = scene.shapes.iter().find_map(|shape| match &shape.geometry {
        Geometry::Mesh(mesh) if shape.path.ends_with(ending) => Some(ControlMesh::clone(mesh)),
        _ => None,
    });
    mesh.expect("a mesh")
}

/// The corners' coordinates.
fn corners_of(mesh: &ControlMesh) -> Vec<Vec2> {
    let st = mesh.primvar("st").expect("coordinates");
    let corners = 0..mesh.face_vertex_indices.len();
    corners
        .map(|corner| Vec2::from_slice(st.get(corner)))
        .collect()
}

#[test]
fn obj_and_usd_get_the_same_coordinates() {
    let bench = Bench::new();
    bench.write("catmark_cube.obj", CUBE);
    for output in ["catmark_a.obj", "b.usda"] {
        let arguments = format!("catmark_cube.obj -o {output} --resolution 256 --margin 2");
        expect(run(&bench, &arguments), 0, &[]);
    }
    let cube = mesh_of(&bench.path("catmark_cube.obj"), "");
    let of_obj = mesh_of(&bench.path("catmark_a.obj"), "");
    let of_usd = mesh_of(&bench.path("b.usda"), "");
    for (name, mesh) in [("OBJ", &of_obj), ("USD", &of_usd)] {
        assert_eq!(mesh.scheme, Scheme::CatmullClark, "{name}");
        assert_eq!(mesh.face_varying, FaceVaryingInterpolation::All, "{name}");
        assert_eq!(mesh.face_vertex_indices, cube.face_vertex_indices, "{name}");
        assert_eq!(mesh.points, cube.points, "{name}");
        assert_eq!(mesh.creases, cube.creases, "{name}");
        assert_eq!(mesh.corners, cube.corners, "{name}");
        assert_eq!(mesh.holes, cube.holes, "{name}");
    }
    assert_eq!(corners_of(&of_obj), corners_of(&of_usd));

    // A layer of a USD file has nothing else, and adds to it.
    expect(run(&bench, "b.usda -o layer.usda --primvar uv"), 0, &[]);
    let layer = std::fs::read_to_string(bench.path("layer.usda")).expect("text");
    assert!(
        layer.contains("over \"Mesh\"") && !layer.contains("points"),
        "{layer}"
    );
    bench.write(
        "both.usda",
        "#usda 1.0\n(\n    subLayers = [@./layer.usda@, @./b.usda@]\n)\n",
    );
    let both = mesh_of(&bench.path("both.usda"), "/Mesh");
    assert!(both.primvar("uv").is_some() && both.primvar("st").is_some());
}

#[test]
fn what_cannot_be_unfolded_is_said() {
    let bench = Bench::new();
    bench.write("cube.obj", CUBE);
    expect(run(&bench, "cube.obj -o a.png"), 2, &[".usda"]);
    expect(
        run(&bench, "cube.obj -o a.obj --margin 4000"),
        2,
        &["margin"],
    );
    expect(
        run(&bench, "cube.obj -o a.obj --max-stretch 1"),
        2,
        &["stretch"],
    );
    expect(run(&bench, "cube.obj -o a.obj --primvar 2d"), 2, &["2d"]);
    expect(run(&bench, "none.obj -o a.obj"), 3, &["none.obj"]);
    let small = run(&bench, "cube.obj -o a.obj --resolution 8 --margin 6");
    expect(small, 3, &["cube.obj", "do not fit into 8 x 8 texels"]);
    bench.write(
        "two.usda",
        "#usda 1.0\ndef Cube \"A\" {}\ndef Cube \"B\" {}\n",
    );
    expect(run(&bench, "two.usda -o a.obj"), 3, &["--prim", "/A, /B"]);
    expect(run(&bench, "two.usda -o a.obj --prim /B"), 0, &[]);
    assert!(!bench.path("a.png").exists());
}

#[test]
fn opensubdivs_cages_can_be_unfolded() {
    let Some(folder) = shared("opensubdivs_cages_can_be_unfolded") else {
        return;
    };
    let mut cages = Vec::new();
    let mut folders = vec![folder.join("assets/opensubdiv")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("cages").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "obj") {
                cages.push(path);
            }
        }
    }
    cages.sort();
    let mut charts = 0;
    for cage in &cages {
        let Ok(scene) = load(cage, &LoadOptions::default()) else {
            continue;
        };
        for mesh in scene
            .shapes
            .iter()
            .filter_map(|shape| shape.geometry.mesh())
        {
            let made = atlas(mesh, &AtlasOptions::default());
            let made = made.unwrap_or_else(|fault| panic!("{}: {fault}", cage.display()));
            charts += made.chart_count;
        }
    }
    println!("{} cages, {charts} charts", cages.len());
    assert!(cages.len() > 20);
}

/// The two ways to one point of an edge, as texture coordinates and as Ptex faces.
struct Crossing {
    st: [Vec2; 2],
    ptex: [(u32, Vec2); 2],
}

/// Points on all edges of two faces.
fn crossings(mesh: &ControlMesh, st: &Primvar) -> Vec<Crossing> {
    const POINTS: u32 = 64;
    let topology = mesh.topology();
    let faces = ptex_faces(mesh);
    let mut all = Vec::new();
    for edge in 0..topology.edge_count() as u32 {
        let &[a, b] = topology.edge_corners(edge) else {
            continue;
        };
        for i in 0..POINTS {
            let t = (i as f32 + 0.5) / POINTS as f32;
            let sides = [(a, t), (b, 1.0 - t)];
            all.push(Crossing {
                st: sides.map(|(corner, t)| {
                    let ends = [corner, topology.next(corner)];
                    let [from, to] = ends.map(|c| Vec2::from_slice(st.get(c as usize)));
                    from.lerp(to, t)
                }),
                ptex: sides.map(|(corner, t)| on_ptex(&topology, &faces, corner, t)),
            });
        }
    }
    all
}

/// The Ptex face and parameters of a point along the edge that leaves a corner.
fn on_ptex(topology: &Topology, faces: &[PtexFace], corner: u32, t: f32) -> (u32, Vec2) {
    let face = topology.face(corner);
    let local = |corner: u32| corner - topology.corners(face).start;
    let number = |sub: Option<u32>| {
        let found = faces.iter().position(|f| f.face == face && f.corner == sub);
        found.expect("a Ptex face") as u32
    };
    if topology.corners(face).len() == 4 {
        let uv = match local(corner) {
            0 => Vec2::new(t, 0.0),
            1 => Vec2::new(1.0, t),
            2 => Vec2::new(1.0 - t, 1.0),
            _ => Vec2::new(0.0, 1.0 - t),
        };
        return (number(None), uv);
    }
    if t < 0.5 {
        (number(Some(local(corner))), Vec2::new(2.0 * t, 0.0))
    } else {
        let next = local(topology.next(corner));
        (number(Some(next)), Vec2::new(0.0, 2.0 - 2.0 * t))
    }
}

/// The mean and the greatest difference.
fn differences(of: impl Iterator<Item = [Vec3; 2]>) -> [f32; 2] {
    let all: Vec<f32> = of.map(|[a, b]| (a - b).abs().max_element()).collect();
    let most = all.iter().copied().fold(0.0, f32::max);
    [all.iter().sum::<f32>() / all.len() as f32, most]
}

#[test]
fn ptex_has_none_of_the_seams_of_an_atlas() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let made = scenes.join("atlas-seams/made");
    if !made.join("heights.exr").exists() {
        println!("SKIPPED: make scenes writes the files of scenes/atlas-seams");
        return;
    }
    let mesh = mesh_of(&scenes.join("atlas-seams/atlas-seams.usda"), "/Gourd");
    let st = mesh.primvar("st").expect("coordinates");
    let (seams, inner): (Vec<_>, Vec<_>) =
        (crossings(&mesh, st).into_iter()).partition(|c| c.st[0].distance(c.st[1]) > 1e-3);
    assert!(seams.len() > 500 && inner.len() > 500);
    for (name, space, filter) in [
        ("colours", ColorSpace::Auto, PtexFilter::default()),
        ("heights", ColorSpace::Raw, PtexFilter::Consistent),
    ] {
        let file = ImageSource::File(made.join(name).with_extension("exr"));
        let image = Texture::load(&file, [Wrap::Clamp; 2], space).expect("an image");
        let options = PtexOptions {
            filter,
            first_channel: 0,
            color_space: space,
        };
        let file = ImageSource::File(scenes.join("ptex/made").join(name).with_extension("ptx"));
        let reader = PtexTexture::open(&file, &Cache::default()).expect("a Ptex file");
        let ptex = PtexTexture::new(reader, &options).expect("its first channel");
        let by_image = |c: &Crossing| c.st.map(|st| image.eval(st).truncate());
        let by_ptex = |c: &Crossing| {
            c.ptex
                .map(|(face, uv)| ptex.eval(face, uv, &Area::POINT).truncate())
        };
        let [seam, within] = [&seams, &inner].map(|all| differences(all.iter().map(by_image)));
        let none = differences(seams.iter().chain(&inner).map(by_ptex));
        println!("{name}: seams {seam:?}, within charts {within:?}, Ptex {none:?}");
        assert!(seam[0] > 0.03 && seam[1] > 0.2, "{name}: {seam:?}");
        assert!(within[1] < 1e-3, "{name}: {within:?}");
        let slack = if filter == PtexFilter::Consistent {
            0.0
        } else {
            1e-2
        };
        assert!(none[1] <= slack, "{name}: {none:?}");
    }
}
