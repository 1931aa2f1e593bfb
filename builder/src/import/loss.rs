//! Counts what an importer has to drop, so that one warning per kind says how much, what and where.

/// Things of one kind that were dropped.
#[derive(Debug, Default)]
pub(super) struct Loss {
    count: usize,
    /// Where the first was, and what it was.
    first: String,
}

impl Loss {
    /// Counts one; `first` says where and what, if it is the first.
    pub(super) fn add(&mut self, first: impl FnOnce() -> String) {
        if self.count == 0 {
            self.first = first();
        }
        self.count += 1;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The warning, e.g. `line 9 and later: 2 faces with a normal that does not exist; they get none`; `None` if there
    /// were none. `what` is in the singular and the plural.
    pub(super) fn warning(&self, what: [&str; 2], consequence: &str) -> Option<String> {
        let Self { count, first } = self;
        match count {
            0 => None,
            1 => Some(format!("{first}: 1 {}; {consequence}", what[0])),
            _ => Some(format!("{first} and later: {count} {}; {consequence}", what[1])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_place_is_named() {
        let mut loss = Loss::default();
        assert_eq!(loss.warning(["face", "faces"], "they are left out"), None);
        loss.add(|| "line 3".into());
        assert_eq!(loss.warning(["face", "faces"], "left out").as_deref(), Some("line 3: 1 face; left out"));
        loss.add(|| panic!("only the first is described"));
        assert_eq!(loss.warning(["face", "faces"], "left out").as_deref(), Some("line 3 and later: 2 faces; left out"));
    }
}
