//! The program as its users meet it: a folder with scenes, arguments, exit codes and messages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

pub const QUAD: &str = "int[] faceVertexCounts = [4]\n    int[] faceVertexIndices = [0, 1, 2, 3]\n";
pub const POINTS: &str = "point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]\n";

/// A stage with one mesh.
pub fn mesh(attributes: &str) -> String {
    format!("#usda 1.0\ndef Mesh \"Quad\" {{\n    {attributes}\n}}\n")
}

pub fn quad(more: &str) -> String {
    mesh(&format!("{QUAD}    {POINTS}    {more}"))
}

/// A folder to write scenes into, and the program to run there.
pub struct Bench(tempfile::TempDir);

impl Bench {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path(name), text).expect("the test's folder takes files");
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relievo"));
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    /// The one JSON object that a command prints.
    pub fn report(&self, arguments: &[&str]) -> Value {
        let output = self.command(arguments).output().expect("the program runs");
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("one object")
    }

    /// A small picture; its exit code and what it said.
    pub fn render(&self, scene: &str, more: &[&str]) -> (i32, String) {
        let small = [
            "render",
            scene,
            "--spp",
            "1",
            "--progress",
            "none",
            "-t",
            "1",
        ];
        let size = ["--res", "8", "6"];
        let mut arguments = small.to_vec();
        arguments.extend(more);
        if !more.contains(&"--res") {
            arguments.extend(size);
        }
        if !more.contains(&"-o") {
            arguments.extend(["-o", "out.exr"]);
        }
        said(&self.command(&arguments).output().expect("the program runs"))
    }
}

pub fn said(output: &Output) -> (i32, String) {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().unwrap_or(-1), text)
}

/// The code, and a message with all of these in it.
#[track_caller]
pub fn expect((code, text): (i32, String), wanted: i32, words: &[&str]) {
    assert_eq!(code, wanted, "{text}");
    for word in words {
        assert!(text.contains(word), "{word} is not in: {text}");
    }
}
