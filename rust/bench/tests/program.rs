//! The program: what it keeps, and what it says of wrong words.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

use std::path::Path;
use std::process::Command;

/// `relume-bench --trial` with arguments, in words, in a desktop session of its own: Mesa's drivers complain where there is none.
fn bench(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relume-bench"));
    command.current_dir(folder).args(["--trial", "--quiet"]).args(arguments.split_whitespace());
    command.env("XDG_RUNTIME_DIR", folder);
    command
}

/// Names of the figures in a file of `relume-bench`.
fn figures(path: &Path) -> Vec<String> {
    let records: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let name = |record: &serde_json::Value| record["name"].as_str().expect("a name").to_owned();
    records.as_array().expect("records").iter().map(name).collect()
}

#[test]
fn figures_of_a_benchmark_are_kept_beside_others_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let measure = |options: &str| {
        let output = bench(folder.path(), &format!("--out bench.json {options}"))
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
        (String::from_utf8(output.stdout).unwrap(), figures(&folder.path().join("bench.json")))
    };
    let traced = ["trial: trace, closed box, paths", "trial: trace, closed box, segments"];
    let solved = ["trial: one light solved, 5 steps on 1 % of 40 x 30 pixels"];
    let (lines, kept) = measure("--device cpu --part tracer");
    assert_eq!(kept, traced);
    assert!(lines.lines().count() == 2 && lines.contains("segments/s"), "{lines}");
    assert_eq!(measure("--device gpu --part light --add").1, [&traced[..], &solved].concat());
    // A figure that is measured again takes the place of the one before.
    let again = measure("--device cpu --part tracer --add").1;
    assert_eq!(again, [&solved[..], &traced].concat());
    assert_eq!(measure("--device gpu --part light").1, solved);
}

#[test]
fn wrong_words_for_a_benchmark_are_answered_with_the_right_ones() {
    let folder = tempfile::tempdir().unwrap();
    let fails = |options: &str, words: &[&str]| {
        let output = bench(folder.path(), options).output().expect("the program starts");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && message.lines().count() == 1, "{options}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{options}: {message}");
    };
    fails("--device cpu --part light", &["no part light", "tracer, rays, gather, networks"]);
    fails("--device gpu --part tracer", &["no part tracer", "device, first-picture", "light"]);
    fails("--device Nonesuch", &["Nonesuch"]);
    std::fs::write(folder.path().join("notes.json"), "{ \"notes\": 1 }").unwrap();
    let keeping = "--device cpu --part tracer --out notes.json --add";
    fails(keeping, &["notes.json", "no records of a benchmark", "--add"]);
    assert!(std::fs::read_to_string(folder.path().join("notes.json")).unwrap().contains("notes"));
    let output = bench(folder.path(), "--add").output().expect("the program starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && message.contains("--out"), "{message}");
}
