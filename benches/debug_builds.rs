//! How much slower a user's crate is in a debug build, without and with the profile that the README advises.
//!
//! `cargo bench -p tau-benches --bench debug_builds`. A crate that depends on `tau` alone is written to
//! `target/debug_builds`, built in three ways, and run in turns; the shortest of the turns counts. It is the crate of
//! `tests/downstream` with a `main` that says how long each of its parts took.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Runs of each build.
const TURNS: usize = 5;
/// What the README advises.
const ADVICE: &str = "
[profile.dev]
opt-level = 1

[profile.dev.package.\"*\"]
opt-level = 3
";
const MAIN: &str = r#"
use std::time::Instant;

use tau::kinematics::Sample;
use tau::{Session, tau_model};

tau_model! {
    pub robot Gantry {
        track one, two, three;
        cluster arm1 on one   { link l1; }
        cluster arm2 on two   { link l2a, l2b; }
        cluster arm3 on three { link l3a, l3b, l3c; }
        variant Shared { arm full; tracks linear; }
        effect runout on cart {
            param sine, cosine: length tol 100 um;
            search period: length in 350 mm ..= 500 mm;
            along += sine * sin(2*pi*q/period) + cosine * cos(2*pi*q/period);
        }
        variant Runout = Shared + runout(two);
    }
}

fn timed<T>(name: &str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    println!("{name}\t{}", start.elapsed().as_secs_f64());
    done
}

fn main() {
    let session = timed("open", || Session::<Gantry>::open(env!("MEASURED"))).unwrap();
    timed("calibrate", || session.calibrate(Gantry::SHARED)).unwrap();
    let runout = timed("calibrate with an effect", || session.calibrate(Gantry::RUNOUT)).unwrap();
    timed("evaluate", || session.evaluate(&runout.machine)).unwrap();
    timed("forward, one pose after another", || {
        for pose in session.folder().tcp_poses.iter().cycle().take(2000) {
            let sample = Sample::new(pose.into(), &pose.commands_m);
            runout.machine.forward(&sample).unwrap();
        }
    });
    timed("discover", || session.discover(Gantry::SHARED)).unwrap();
}
"#;

/// A way to build it: a name, more of its manifest, arguments of cargo, and where the program is.
const BUILDS: [(&str, &str, &[&str], &str); 3] = [
    ("release", "", &["--release"], "release"),
    ("dev", "", &[], "debug"),
    ("dev, advised profile", ADVICE, &[], "debug"),
];

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut best: BTreeMap<(String, &str), f64> = BTreeMap::new();
    let mut parts: Vec<String> = Vec::new();
    let programs = BUILDS.map(|(name, profile, arguments, folder)| {
        let place = root
            .join("target/debug_builds")
            .join(name.replace([',', ' '], "_"));
        write(&root, &place, profile);
        let built = Command::new("cargo")
            .args(["build", "--quiet"])
            .args(arguments)
            .env("MEASURED", root.join("data/prototype"))
            .env_remove("CARGO_TARGET_DIR")
            .current_dir(&place)
            .status();
        assert!(built.expect("cargo").success(), "{name}");
        (name, place.join("target").join(folder).join("user"))
    });
    for _ in 0..TURNS {
        for (name, program) in &programs {
            let ran = Command::new(program).output().expect("the program");
            assert!(ran.status.success(), "{name}");
            for line in String::from_utf8_lossy(&ran.stdout).lines() {
                let (part, seconds) = line.split_once('\t').expect("a part and its time");
                let seconds: f64 = seconds.parse().expect("seconds");
                if !parts.iter().any(|known| known == part) {
                    parts.push(part.to_owned());
                }
                let least = best.entry((part.to_owned(), name)).or_insert(seconds);
                *least = least.min(seconds);
            }
        }
    }
    println!("| part | release | dev | dev, advised profile |");
    println!("| --- | ---: | ---: | ---: |");
    for part in parts {
        let of = |name| best[&(part.clone(), name)];
        let [release, dev, advised] = BUILDS.map(|(name, ..)| of(name));
        println!(
            "| {part} | {:.1} ms | {:.1} times | {:.2} times |",
            1e3 * release,
            dev / release,
            advised / release
        );
    }
}

/// Writes the crate; the dependencies are those of this workspace.
fn write(root: &Path, place: &Path, profile: &str) {
    fs::create_dir_all(place.join("src")).expect("a folder");
    let tau = fs::canonicalize(root.join("tau")).expect("the library");
    let manifest = format!(
        "[package]\nname = \"user\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n\n\
         [dependencies]\ntau = {{ package = \"tau-model\", path = \"{}\" }}\n{profile}",
        tau.display()
    );
    fs::write(place.join("Cargo.toml"), manifest).expect("a manifest");
    fs::write(place.join("src/main.rs"), MAIN).expect("a program");
    let lock = root.join("Cargo.lock");
    fs::copy(lock, place.join("Cargo.lock")).expect("the lock file");
}
