//! Faults with their place, and the exit code that each kind has.

use std::fmt;
use std::path::PathBuf;

/// What every fallible call of the library returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why relievo stopped. Each kind has an exit code of its own ([`Error::exit_code`]).
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The command line asks for something that makes no sense.
    #[error("{message}")]
    Usage {
        /// What is wrong with it.
        message: String,
        /// What to do about it.
        help: Option<String>,
    },
    /// A scene, mesh or texture is missing or wrong.
    #[error(transparent)]
    Input(Box<Fault>),
    /// The scene does not fit into the memory that it was given.
    #[error("{message}")]
    Memory {
        /// What was asked for and what there is.
        message: String,
        /// What would fit.
        help: Option<String>,
    },
    /// The user asked to stop; what was rendered by then is written.
    #[error("interrupted")]
    Interrupted,
    /// Anything else: a full disk, a library that refuses.
    #[error("{message}")]
    Failed {
        /// What failed, with the reason that the system or the library gave.
        message: String,
        /// What to do about it.
        help: Option<String>,
    },
}

impl Error {
    /// An [`Error::Usage`].
    pub fn usage(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Usage {
            message: message.into(),
            help: Some(help.into()),
        }
    }

    /// An [`Error::Failed`] without advice.
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed {
            message: message.into(),
            help: None,
        }
    }

    /// What to do about it, where that can be said.
    pub fn help(&self) -> Option<&str> {
        match self {
            Self::Usage { help, .. } | Self::Memory { help, .. } | Self::Failed { help, .. } => {
                help.as_deref()
            }
            Self::Input(fault) => fault.help.as_deref(),
            Self::Interrupted => None,
        }
    }

    /// The process's exit code: 1 failed, 2 usage, 3 bad input, 4 out of memory budget, 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Failed { .. } => 1,
            Self::Usage { .. } => 2,
            Self::Input(_) => 3,
            Self::Memory { .. } => 4,
            Self::Interrupted => 130,
        }
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Self {
        if fault.for_want_of_memory {
            return Self::Memory {
                message: fault.to_string(),
                help: Some("let the program have more memory".to_owned()),
            };
        }
        Self::Input(Box::new(fault))
    }
}

/// Bad input, with its place: `message (file, prim, face)` and what to do about it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Fault {
    /// What is wrong, with the offending value.
    pub message: String,
    /// The file that holds it.
    pub file: Option<PathBuf>,
    /// The prim, or the OBJ's group or line, that holds it.
    pub prim: Option<String>,
    /// The face of the control mesh, from 0.
    pub face: Option<usize>,
    /// What to do about it.
    pub help: Option<String>,
    /// Whether nothing is wrong but that there was no memory to find out.
    pub for_want_of_memory: bool,
}

impl Fault {
    /// A fault that knows no place yet.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            ..Self::default()
        }
    }

    /// What could not be read for want of memory: it becomes an [`Error::Memory`].
    pub fn for_want_of_memory(message: impl Into<String>) -> Self {
        Self {
            for_want_of_memory: true,
            ..Self::new(message)
        }
    }

    /// Names the file, if no deeper layer has named one.
    #[must_use]
    pub fn in_file(mut self, file: impl Into<PathBuf>) -> Self {
        self.file.get_or_insert_with(|| file.into());
        self
    }

    /// Names the prim, if no deeper layer has named one.
    #[must_use]
    pub fn at_prim(mut self, prim: impl Into<String>) -> Self {
        self.prim.get_or_insert_with(|| prim.into());
        self
    }

    /// Names the face.
    #[must_use]
    pub fn at_face(mut self, face: usize) -> Self {
        self.face = Some(face);
        self
    }

    /// Says what to do about it.
    #[must_use]
    pub fn advise(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl From<relievo_ptex::Error> for Fault {
    fn from(e: relievo_ptex::Error) -> Self {
        Self {
            message: e.message().to_owned(),
            file: e.path().map(Into::into),
            prim: None,
            face: e.face().map(|face| face as usize),
            help: Some(e.help().to_owned()),
            for_want_of_memory: false,
        }
    }
}

impl From<relievo_ptex::Error> for Error {
    fn from(e: relievo_ptex::Error) -> Self {
        Fault::from(e).into()
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        if let Some(prim) = &self.prim {
            write!(f, "{prim}: ")?;
        }
        if let Some(face) = self.face {
            write!(f, "face {face}: ")?;
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for Fault {}

/// Things that relievo noticed and went on without: each kind is told once, with how often it occurred.
#[derive(Debug, Clone, Default)]
pub struct Warnings(Vec<Warning>);

/// One kind of warning.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Warning {
    /// The kind, a stable short name: `unsupported-prim-type`.
    pub kind: String,
    /// The first occurrence, in full, with its prim.
    pub message: String,
    /// How often it occurred.
    pub count: usize,
}

impl Warnings {
    /// Notes `message`; further ones of the same `kind` are only counted. Make the kind as fine as the user
    /// needs: `unsupported prim type Cube` and `… Cone` are two kinds.
    pub fn add(&mut self, kind: impl Into<String>, message: impl FnOnce() -> String) {
        let kind = kind.into();
        match self.0.iter_mut().find(|w| w.kind == kind) {
            Some(warning) => warning.count += 1,
            None => self.0.push(Warning {
                kind,
                message: message(),
                count: 1,
            }),
        }
    }

    /// All kinds, in the order in which they first occurred.
    pub fn iter(&self) -> impl Iterator<Item = &Warning> {
        self.0.iter()
    }

    /// Takes over what another collector noted.
    pub fn extend(&mut self, other: Self) {
        for warning in other.0 {
            match self.0.iter_mut().find(|w| w.kind == warning.kind) {
                Some(mine) => mine.count += warning.count,
                None => self.0.push(warning),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_reads_from_file_to_face() {
        let fault = Fault::new("index 9 of 8 points")
            .at_face(3)
            .at_prim("/Cube")
            .in_file("a.usda");
        assert_eq!(
            fault.to_string(),
            "a.usda: /Cube: face 3: index 9 of 8 points"
        );
        assert_eq!(Error::from(fault).exit_code(), 3);
        let fault = Fault::for_want_of_memory("too large").in_file("a.exr");
        assert_eq!(Error::from(fault).exit_code(), 4);
    }

    #[test]
    fn a_warning_is_told_once() {
        let mut warnings = Warnings::default();
        warnings.add("k", || "first".into());
        warnings.add("k", || unreachable!());
        let all: Vec<_> = warnings.iter().collect();
        assert_eq!(
            (all.len(), all[0].count, all[0].message.as_str()),
            (1, 2, "first")
        );
    }
}
