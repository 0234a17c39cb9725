//! `relievo ptex check`.

use std::path::PathBuf;

use clap::Args;
use relievo::Result;
use relievo::error::Fault;
use relievo_ptex::{Cache, Finding, Reader, Severity, check};
use serde_json::json;

/// Read all of a Ptex file and name everything that is wrong with it, a line each.
///
/// `unreadable` are data that no reader can give, `wrong` is what makes some readers or filters give wrong values, `odd`
/// what harms nobody. The exit code is 3 if anything is unreadable or wrong.
#[derive(Debug, Args)]
pub(crate) struct Check {
    /// Ptex file.
    file: PathBuf,
    /// Print one JSON object instead of lines.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub(crate) fn run(self) -> Result<()> {
        let reader = Reader::open(&self.file, &Cache::default())?;
        let findings = check(&reader);
        let text = match self.json {
            true => {
                let list: Vec<_> = findings.iter().map(object).collect();
                format!("{}\n", json!({ "file": self.file, "findings": list }))
            }
            false if findings.is_empty() => format!("{}: nothing is wrong\n", self.file.display()),
            false => findings
                .iter()
                .map(|finding| format!("{}: {finding}\n", self.file.display()))
                .collect(),
        };
        super::super::print(text.as_bytes())?;
        let count = |severity| findings.iter().filter(|f| f.severity == severity).count();
        match (count(Severity::Unreadable), count(Severity::Wrong)) {
            (0, 0) => Ok(()),
            (unreadable, wrong) => {
                let found = format!("{unreadable} data of it cannot be read, {wrong} are wrong");
                let fault = Fault::new(found).in_file(&self.file);
                Err(fault
                    .advise("Copy it again from where it came, or write it again.")
                    .into())
            }
        }
    }
}

fn object(finding: &Finding) -> serde_json::Value {
    let severity = match finding.severity {
        Severity::Odd => "odd",
        Severity::Wrong => "wrong",
        Severity::Unreadable => "unreadable",
    };
    json!({ "severity": severity, "face": finding.face, "message": finding.message })
}
