//! A list of shots of any text is refused, or each shot has the name of a file of its own that leaves no folder.
#![no_main]

use libfuzzer_sys::fuzz_target;
use relume_session::ShotList;
use std::collections::HashSet;
use std::path::{Component, Path};

fuzz_target!(|text: &str| {
    let Ok(list) = ShotList::parse(text) else { return };
    let names = list.file_names();
    assert_eq!(names.len(), list.shots.len());
    for name in &names {
        let mut parts = Path::new(name).components();
        assert!(matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)), "{name:?}");
    }
    let different: HashSet<String> = names.iter().map(|name| name.to_lowercase()).collect();
    assert_eq!(different.len(), names.len(), "{names:?}");
});
