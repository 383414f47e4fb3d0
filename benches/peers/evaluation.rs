//! Residual and ten derivatives of one link's closure, per sample.

use std::collections::BTreeMap;
use std::fs;
use std::hint::black_box;
use std::path::PathBuf;

use tau_codegen::Family;
use tau_generated::gantry_tau::{ROBOT, full::Closure};
use tau_runtime::{
    Formulas, Kernel, LANES, Lanes, NormalEquations, ResidualFamily, ResidualKind, block_count,
};

use crate::by_hand;
use crate::program::Program;
use crate::samples::{PARAMETERS, SAMPLES, closure, data, difference, reference, rows, text};
use crate::{least_seconds, setup};

/// Turns that every contender takes, and calls of which a turn counts the fastest.
const TURNS: usize = 150;
const CALLS: usize = 5;
/// Contenders agree to this; numeric differences only to their own error.
const AGREEMENT: f64 = 1e-12;
const AGREEMENT_NUMERIC: f64 = 1e-8;
/// Numbers read and written per sample by the staged functions: 13 prepared, a residual, ten derivatives.
const STAGED_BYTES: f64 = 8.0 * 24.0;

/// A way to compute all samples, with what is known of it.
struct Contender {
    name: String,
    /// Instruction set it was compiled for.
    built: &'static str,
    operations: Option<usize>,
    /// Difference from the generated single-sample code.
    difference: Option<f64>,
    run: Box<dyn FnMut()>,
    seconds: f64,
}

/// The closure family of `Full`, with its programs.
fn compiled() -> Family {
    let model = tau_codegen::language::check_text(ROBOT.description).expect("a description");
    let full = model
        .variants
        .iter()
        .position(|variant| variant.name == "Full");
    let variant = tau_codegen::compile::compile_some(&model, full.expect("a variant"), |_, _| true);
    let mut families = variant.families.into_iter();
    families
        .find(|family| family.kind == ResidualKind::Closure)
        .expect("a family")
}

/// Rows from blocks.
fn block_rows(r: &[Lanes], j: &[Lanes]) -> Vec<f64> {
    (0..SAMPLES)
        .flat_map(|sample| {
            let (block, lane) = (sample / LANES, sample % LANES);
            let derivatives = j[block * 10..(block + 1) * 10].iter();
            std::iter::once(&r[block])
                .chain(derivatives)
                .map(move |lanes| lanes[lane])
        })
        .collect()
}

/// The generated formulas without choice of instruction set.
struct Generated;

impl Kernel for Generated {
    #[inline(always)]
    fn run(self, prepared: &[Lanes], parameters: &[f64], r: &mut [Lanes], j: &mut [Lanes]) {
        assert_eq!(parameters.len(), 10);
        let (prepared, _) = prepared.as_chunks::<{ Closure::SHAPE.prepared }>();
        let (rows, _) = j.as_chunks_mut::<10>();
        for ((prepared, r), row) in prepared.iter().zip(r.chunks_exact_mut(1)).zip(rows) {
            for lane in 0..LANES {
                <Closure as Formulas>::linearize(lane, prepared, parameters, r, row);
            }
        }
    }
}

/// Contenders that run in this process.
struct Contenders {
    data: Vec<f64>,
    reference: Vec<f64>,
    list: Vec<Contender>,
}

impl Contenders {
    /// Adds a function that writes residuals and derivatives sample by sample.
    fn singles(
        &mut self,
        name: &str,
        operations: Option<usize>,
        agreement: f64,
        mut function: impl FnMut(&[f64; 10], &mut [f64], &mut [f64]) + 'static,
    ) {
        let (mut r, mut j) = (vec![0.0; SAMPLES], vec![0.0; 10 * SAMPLES]);
        function(&PARAMETERS, &mut r, &mut j);
        let difference = difference(&rows(&r, &j), &self.reference);
        let run = Box::new(move || {
            function(&by_hand::parameters(), &mut r, &mut j);
            black_box((&mut r, &mut j));
        });
        self.add(
            name,
            "any x86-64",
            operations,
            Some(difference),
            run,
            agreement,
        );
    }

    /// Adds a function that writes them in blocks.
    fn blocks(
        &mut self,
        name: &str,
        built: &'static str,
        operations: usize,
        mut function: impl FnMut(&[f64; 10], &mut [Lanes], &mut [Lanes]) + 'static,
    ) {
        let lanes = |width: usize| vec![Lanes::ZERO; block_count(SAMPLES) * width];
        let (mut r, mut j) = (lanes(1), lanes(10));
        function(&PARAMETERS, &mut r, &mut j);
        let difference = difference(&block_rows(&r, &j), &self.reference);
        let run = Box::new(move || {
            function(&by_hand::parameters(), &mut r, &mut j);
            black_box((&mut r, &mut j));
        });
        self.add(
            name,
            built,
            Some(operations),
            Some(difference),
            run,
            AGREEMENT,
        );
    }

    fn add(
        &mut self,
        name: &str,
        built: &'static str,
        operations: Option<usize>,
        difference: Option<f64>,
        run: Box<dyn FnMut()>,
        agreement: f64,
    ) {
        if let Some(difference) = difference {
            assert!(difference <= agreement, "{name} differs by {difference:e}");
        }
        self.list.push(Contender {
            name: name.to_owned(),
            built,
            operations,
            difference,
            run,
            seconds: f64::INFINITY,
        });
    }

    fn of_tau(&mut self, compiled: &Family) {
        let family = closure();
        let staged = compiled.programs.linearize.counts().total();
        let whole = staged + compiled.programs.prepare.counts().total();
        let interpreted = compiled.interpreted();
        let mut prepared = vec![0.0; SAMPLES * family.shape().prepared];
        family.prepare_all(&self.data, &mut prepared);
        let in_blocks = prepared_blocks(family, &self.data);
        let lanes = in_blocks.clone();
        self.blocks(
            "generated, blocks",
            chosen_at_run_time(),
            staged,
            move |p, r, j| {
                family
                    .blocks()
                    .expect("blocks")
                    .linearize_blocks(&lanes, p, r, j);
            },
        );
        let lanes = in_blocks.clone();
        self.blocks("generated, blocks", "any x86-64", staged, move |p, r, j| {
            Generated.run(&lanes, p, r, j);
        });
        self.singles(
            "generated, staged",
            Some(staged),
            AGREEMENT,
            move |p, r, j| {
                family.linearize_all(&prepared, p, r, j);
            },
        );
        let data = self.data.clone();
        let mut prepared = vec![0.0; SAMPLES * family.shape().prepared];
        self.singles(
            "generated, nothing staged",
            Some(whole),
            AGREEMENT,
            move |p, r, j| {
                family.prepare_all(&data, &mut prepared);
                family.linearize_all(&prepared, p, r, j);
            },
        );
        let lanes = prepared_blocks(&*interpreted, &self.data);
        self.blocks(
            "interpreted, blocks",
            chosen_at_run_time(),
            staged,
            move |p, r, j| {
                interpreted
                    .blocks()
                    .expect("blocks")
                    .linearize_blocks(&lanes, p, r, j);
            },
        );
        self.normal_equations(family, in_blocks, staged);
    }

    /// Residual, derivatives and their 66 products, without storing the Jacobian.
    fn normal_equations(
        &mut self,
        family: &'static dyn ResidualFamily,
        prepared: Vec<Lanes>,
        staged: usize,
    ) {
        let weights = vec![Lanes::splat(1.0); block_count(SAMPLES)];
        let sizes = NormalEquations::new(family.shape(), family.pattern());
        let mut scratch = vec![Lanes::ZERO; sizes.scratch()];
        let mut sums = vec![Lanes::ZERO; sizes.sums()];
        let operations = staged + 11 + 2 * sizes.sums();
        let run = Box::new(move || {
            let family = family.blocks().expect("blocks");
            let parameters = by_hand::parameters();
            sums.fill(Lanes::ZERO);
            sizes.add(
                family,
                &prepared,
                &parameters,
                &weights,
                &mut scratch,
                &mut sums,
            );
            black_box(&mut sums);
        });
        let name = "generated, normal equations";
        self.add(name, chosen_at_run_time(), Some(operations), None, run, 0.0);
    }

    fn of_others(&mut self) {
        let staged = Some(by_hand::STAGED_OPERATIONS);
        let lanes = by_hand::prepare_blocks(&self.data);
        let same = lanes.clone();
        let operations = by_hand::STAGED_OPERATIONS;
        self.blocks(
            "by hand, blocks",
            chosen_at_run_time(),
            operations,
            move |p, r, j| {
                by_hand::in_blocks(&lanes, p, r, j);
            },
        );
        self.blocks(
            "by hand, blocks",
            "any x86-64",
            operations,
            move |p, r, j| {
                by_hand::in_blocks_anywhere(&same, p, r, j);
            },
        );
        let prepared = by_hand::prepare_all(&self.data);
        self.singles("by hand, staged", staged, AGREEMENT, move |p, r, j| {
            by_hand::staged(&prepared, p, r, j);
        });
        let [a, b, c, d] = std::array::from_fn(|_| self.data.clone());
        let plain = Some(by_hand::PLAIN_OPERATIONS);
        self.singles("by hand, plain", plain, AGREEMENT, move |p, r, j| {
            by_hand::plain(&a, p, r, j);
        });
        self.singles(
            "num-dual, `DualSVec64<10>`",
            None,
            AGREEMENT,
            move |p, r, j| {
                by_hand::dual_numbers(&b, p, r, j);
            },
        );
        let passes = "num-dual, `Dual64` in ten passes";
        self.singles(passes, None, AGREEMENT, move |p, r, j| {
            by_hand::dual_passes(&d, p, r, j);
        });
        self.singles(
            "central differences",
            None,
            AGREEMENT_NUMERIC,
            move |p, r, j| {
                by_hand::numeric(&c, p, r, j);
            },
        );
    }
}

fn prepared_blocks(family: &dyn ResidualFamily, data: &[f64]) -> Vec<Lanes> {
    let mut lanes = vec![Lanes::ZERO; block_count(SAMPLES) * family.shape().prepared];
    family
        .blocks()
        .expect("blocks")
        .prepare_blocks(data, &mut lanes);
    lanes
}

/// A peer's program with how it was built, and what it said so far: seconds and result by name.
struct Peer {
    program: Program,
    built: &'static str,
    seen: BTreeMap<String, (f64, f64)>,
}

/// Measures all contenders and prints the table.
pub(crate) fn print() {
    println!("## Residual and ten derivatives, per sample\n");
    let data = data(SAMPLES);
    let reference = reference(&data);
    let file = setup::folder().join("samples.txt");
    fs::write(&file, text(&data, &reference)).expect("a file of samples");

    let generators = setup::or_say("wrenfold and SymForce", setup::generate());
    let generated = generators.as_ref().map(|(folder, _)| folder.as_path());
    let mut peers = Vec::new();
    let mut start = |what: &str, built, program: Result<PathBuf, String>, arguments: &[&str]| {
        let program = program.and_then(|path| {
            Program::start(&path, arguments, &file).ok_or_else(|| "does not start".to_owned())
        });
        if let Some(program) = setup::or_say(what, program) {
            peers.push(Peer {
                program,
                built,
                seen: BTreeMap::new(),
            });
        }
    };
    let rust = "Rust of other generators";
    start(
        rust,
        "this machine",
        setup::rust(generated, true),
        &["--machine"],
    );
    if generated.is_some() {
        start(rust, "any x86-64", setup::rust(generated, false), &[]);
    }
    start("Ceres Solver", "this machine", setup::ceres(), &["samples"]);
    start("arael", "this machine", setup::arael(), &[]);

    let mut contenders = Contenders {
        data,
        reference,
        list: Vec::new(),
    };
    contenders.of_tau(&compiled());
    contenders.of_others();
    for _ in 0..TURNS {
        for contender in &mut contenders.list {
            let seconds = least_seconds(CALLS, &mut contender.run);
            contender.seconds = contender.seconds.min(seconds);
        }
        for peer in &mut peers {
            for turn in peer.program.turn() {
                let seen = peer.seen.entry(turn.name).or_insert((f64::INFINITY, 0.0));
                *seen = (seen.0.min(turn.seconds), turn.result);
            }
        }
    }
    let operations_of = |name: &str| {
        let (_, generators) = generators.as_ref()?;
        let generator = generators.iter().find(|generator| generator.name == name)?;
        generator.operations.parse().ok()
    };
    let machine = Machine::of(&peers);
    table(&contenders.list, &peers, &machine, operations_of);
}

/// Instruction set that generated code takes on this machine.
fn chosen_at_run_time() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            return "AVX-512 at run time";
        }
        if is_x86_feature_detected!("avx2") {
            return "AVX2 at run time";
        }
    }
    "any"
}

/// Limits of this machine, from the same run.
struct Machine {
    /// Multiply-adds from registers, two operations each (1/s).
    flops: Option<f64>,
    /// Sum of two arrays, one scaled, in the second cache and in memory (bytes/s).
    cached: Option<f64>,
    memory: Option<f64>,
}

impl Machine {
    fn of(peers: &[Peer]) -> Self {
        let rate = |name: &str| {
            let &(seconds, work) = peers.iter().find_map(|peer| peer.seen.get(name))?;
            Some(work / seconds)
        };
        Self {
            flops: rate("peak"),
            cached: rate("triad in cache"),
            memory: rate("triad in memory"),
        }
    }
}

fn table(
    own: &[Contender],
    peers: &[Peer],
    machine: &Machine,
    operations_of: impl Fn(&str) -> Option<usize>,
) {
    let unit = own[0].seconds;
    println!(
        "| implementation | instructions | ns per sample | generated blocks = 1 | operations | Gflop/s | of peak | times the limit | largest difference |\n\
         | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    );
    // No staged evaluation that stores its row is faster than the cache that the samples are in.
    let limit = machine
        .cached
        .map(|cached| STAGED_BYTES * SAMPLES as f64 / cached);
    let row =
        |name: &str, built: &str, seconds: f64, operations: Option<usize>, difference: f64| {
            let dash = || "–".to_owned();
            let rate = operations.map(|count| (count * SAMPLES) as f64 / seconds);
            let share = rate
                .zip(machine.flops)
                .map(|(rate, peak)| 100.0 * rate / peak);
            println!(
                "| {name} | {built} | {:.2} | {:.2} | {} | {} | {} | {} | {} |",
                1e9 * seconds / SAMPLES as f64,
                seconds / unit,
                operations.map_or_else(dash, |count| count.to_string()),
                rate.map_or_else(dash, |rate| format!("{:.2}", rate / 1e9)),
                share.map_or_else(dash, |share| format!("{share:.1} %")),
                limit.map_or_else(dash, |limit| format!("{:.1}", seconds / limit)),
                match difference {
                    0.0 => "0".to_owned(),
                    known if known.is_finite() => format!("{known:.0e}"),
                    _ => dash(),
                },
            );
        };
    for contender in own {
        let difference = contender.difference.unwrap_or(f64::NAN);
        let (name, operations) = (&contender.name, contender.operations);
        row(
            name,
            contender.built,
            contender.seconds,
            operations,
            difference,
        );
    }
    let known = [
        ("wrenfold", "wrenfold, Rust"),
        ("symforce", "SymForce, Rust"),
        ("jet", "Ceres `Jet<double, 10>`, called directly"),
        ("cost function", "Ceres `AutoDiffCostFunction`"),
        ("arael", "arael, normal equations"),
        ("arael staged", "arael, normal equations, rotations as data"),
    ];
    for (key, name) in known {
        for peer in peers {
            if let Some(&(seconds, difference)) = peer.seen.get(key) {
                assert!(difference <= AGREEMENT, "{name} differs by {difference:e}");
                row(name, peer.built, seconds, operations_of(key), difference);
            }
        }
    }
    println!();
    if let (Some(flops), Some(cached), Some(memory)) =
        (machine.flops, machine.cached, machine.memory)
    {
        let moved = STAGED_BYTES * SAMPLES as f64 / unit;
        println!(
            "Peak: {:.1} Gflop/s (multiply-adds from registers, one core). \
             A triad moves {:.1} GB/s in cache and {:.1} GB/s in memory; the generated blocks move {:.1} GB/s.\n",
            flops / 1e9,
            cached / 1e9,
            memory / 1e9,
            moved / 1e9
        );
    }
}
