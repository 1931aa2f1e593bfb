//! The report of a validation.

use std::fmt;

use esvo_spec::{Level, rule};

use crate::Broken;

/// Largest number of findings in a report. Further findings are only counted.
const MAX_FINDINGS: usize = 1000;

/// A rule that the bytes break.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Finding {
    /// Whether the rule is a SHOULD of the specification, not a MUST.
    pub warning: bool,
    /// The rule, the offset and what was found there.
    #[serde(flatten)]
    pub broken: Broken,
}

/// What validation found.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Report {
    /// The first thousand findings, in the order of the checks.
    pub findings: Vec<Finding>,
    /// Number of findings that are not listed.
    pub left_out: u64,
    /// Number of errors among all findings. The others are warnings.
    pub errors: u64,
}

impl Report {
    /// Whether there are no errors. There may be warnings.
    pub fn is_ok(&self) -> bool {
        self.errors == 0
    }

    pub(crate) fn add(&mut self, broken: Broken) {
        let warning = rule(broken.rule).is_some_and(|rule| rule.level == Level::Should);
        self.errors += u64::from(!warning);
        if self.findings.len() < MAX_FINDINGS {
            self.findings.push(Finding { warning, broken });
        } else {
            self.left_out += 1;
        }
    }
}

impl fmt::Display for Report {
    /// One line per finding and a summary line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for finding in &self.findings {
            let kind = if finding.warning { "warning" } else { "error" };
            writeln!(f, "{kind} {}: {}", finding.broken.rule, finding.broken)?;
        }
        if self.left_out > 0 {
            writeln!(f, "{} more findings are not listed", self.left_out)?;
        }
        let warnings = self.findings.len() as u64 + self.left_out - self.errors;
        let plural = |number| if number == 1 { "" } else { "s" };
        write!(f, "{} error{}, {warnings} warning{}", self.errors, plural(self.errors), plural(warnings))
    }
}
