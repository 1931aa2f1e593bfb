//! A program that is asked to stop while it writes. Alone in its process, as the list of temporary files belongs to the
//! process.

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
