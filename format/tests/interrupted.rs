//! A program that is told to stop while it writes. By itself in its process: the list of temporaries is the process's.

#[test]
fn what_is_begun_can_be_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let result = esvo_format::write_atomically(&folder.path().join("file"), |out| {
        out.write_all(&[0; 100])?;
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "the temporary");
        esvo_format::remove_temporaries();
        Ok(())
    });
    result.unwrap_err();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
