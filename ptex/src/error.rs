//! What goes wrong with a Ptex file: where, with which value, and what to do about it.

use std::fmt;
use std::path::{Path, PathBuf};

/// What every fallible call of the library returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What to do with most files that cannot be read.
pub(crate) const DAMAGED: &str =
    "the file is damaged: copy it again from where it came, or write it again";

/// Why a file, or a face of it, could not be read or written. A pointer in size, so that results stay small where
/// texels are summed.
#[derive(Clone)]
pub struct Error(Box<Inner>);

/// Of what kind an [`Error`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The system would not read or write.
    Io,
    /// The file is not as the format says.
    Malformed,
    /// What was asked for cannot be: a face that is not there, a size that is larger than the face's.
    Request,
    /// It would take more memory than the cache's budget, and than the file's size can justify.
    Memory,
}

#[derive(Clone)]
struct Inner {
    kind: ErrorKind,
    message: String,
    help: String,
    path: Option<PathBuf>,
    face: Option<u32>,
}

impl Error {
    pub(crate) fn new(
        kind: ErrorKind,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        Self(Box::new(Inner {
            kind,
            message: message.into(),
            help: help.into(),
            path: None,
            face: None,
        }))
    }

    pub(crate) fn malformed(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Malformed, message, DAMAGED)
    }

    pub(crate) fn request(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self::new(ErrorKind::Request, message, help)
    }

    pub(crate) fn io(doing: &str, error: &std::io::Error) -> Self {
        Self::new(
            ErrorKind::Io,
            format!("{doing}: {error}"),
            "see that the path is right and may be used",
        )
    }

    /// Names the file, if none is named yet.
    #[must_use]
    pub(crate) fn in_file(mut self, path: &Path) -> Self {
        self.0.path.get_or_insert_with(|| path.to_owned());
        self
    }

    /// Names the face, if none is named yet.
    #[must_use]
    pub(crate) fn at_face(mut self, face: u32) -> Self {
        self.0.face.get_or_insert(face);
        self
    }

    /// Of what kind it is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// What is wrong, with the offending value.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.0.message
    }

    /// What to do about it.
    #[must_use]
    pub fn help(&self) -> &str {
        &self.0.help
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.0.path.as_deref()
    }

    /// The face, where one is at fault.
    #[must_use]
    pub fn face(&self) -> Option<u32> {
        self.0.face
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(path) = &self.0.path {
            write!(f, "{}: ", path.display())?;
        }
        if let Some(face) = self.0.face {
            write!(f, "face {face}: ")?;
        }
        write!(f, "{}; {}", self.0.message, self.0.help)
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {self}", self.0.kind)
    }
}

impl std::error::Error for Error {}
