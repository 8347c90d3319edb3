//! Calls and stack depth of the tasks of an image: no tick panics, and all tasks together fit the stack.
//!
//! A *panic* is a call of a routine of `core` that leads to the panic handler. A trap in code that the
//! compiler has proved unreachable is none.
//!
//! The stack is an upper bound: each priority is interrupted by each higher one where it is deepest, and by a fault
//! handler. A function that jumps to another at its end counts as if it kept its frame, a panic as if it went on. What start-up calls
//! runs with interrupts masked: only a fault handler comes on top of it.

use super::graph::{Function, Graph};
use edm_hal_shim::board::{LOGS, TASKS, Task};
use petgraph::algo::tarjan_scc;
use petgraph::graphmap::DiGraphMap;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;

/// Bytes of an exception frame with the state of the FPU, 26 words, and what aligns it (ARMv7-M manual, B1.5.7).
pub const EXCEPTION: u32 = 26 * 4 + 4;

/// Beginnings of the names of what may belong to a routine that panics.
const ROUTINES: [&str; 3] = ["core::", "<core::", "OUTLINED_FUNCTION_"];

/// What cannot be read in the machine code. Names are those of the source; each line has to be of use, or it is refused.
pub struct Rules {
    tasks: &'static [Task],
    /// Vectors that are no tasks and never come back.
    dying: &'static [&'static str],
    /// Functions of start-up that enable interrupts when all their calls are done.
    starts: &'static [&'static str],
    /// The priority from which on tasks run from RAM, and what they call; `None`: no image of this kind has code there.
    fast: Option<u8>,
    /// What is in the names of those that may lie in flash all the same: once a millisecond or less, once in a fault, or a short loop,
    /// which the flash accelerator keeps and which would share RAM with what it copies.
    flash: &'static [&'static str],
    indirect: &'static [Indirect],
    panics: &'static [Panics],
    recursions: &'static [Recursion],
}

/// Where calls go that name no function but take an address from a register.
struct Indirect {
    /// Beginnings of the names of callers.
    from: &'static [&'static str],
    /// What is in the names of those that they call. Every function whose address is taken is in one line at least.
    to: &'static [&'static str],
    /// Why these and no others.
    why: &'static str,
}

/// Who may panic.
struct Panics {
    /// Beginnings of the names of functions that call a routine.
    from: &'static [&'static str],
    /// What is in the names of the routines.
    to: &'static [&'static str],
    /// The highest task that may reach it.
    task: &'static str,
    /// Why it stays.
    why: &'static str,
}

/// A recursion that ends after one round.
struct Recursion {
    /// Symbol of one of its functions.
    through: &'static str,
    /// What ends it.
    why: &'static str,
}

/// The head.
pub const HEAD: Rules = Rules {
    tasks: TASKS,
    dying: &["HardFault", "DefaultHandler"],
    starts: &["__rtic_init_resources"],
    fast: Some(4),
    flash: &[
        "Servo<B>::sight",
        "Gap<B>::look",
        "Gap<B>::retune",
        "Velocity::new",
        "Velocity::stand",
        "Follower::miss",
        "Follower::probe",
        "Follower::unread",
        "Recorder::complete",
        "Recorder::order",
        "pause::follow",
        "memclr",
        "memcpy",
        "memmove",
    ],
    indirect: &[
        Indirect {
            from: &["edm_canopen::"],
            to: &["Dictionary for edm_servo_head::canopen::drive::Drive>::", "edm_canopen::"],
            why: "the node knows its device as `dyn Dictionary`, and some functions of its own by their addresses",
        },
        Indirect {
            from: &["edm_store::", "sequential_storage::", "<&mut T as embedded_storage_async::"],
            to: &[" as edm_store::Cells>::", " as edm_store::Permit>::", " as sequential_storage::map::Value>::"],
            why: "the store knows flash and permit as traits, and its library what is stored",
        },
        Indirect {
            from: &[],
            to: &["core::fmt::", "core::ptr::drop_in_place<"],
            why: "never called: the panic handler takes file and line, not the text, and nothing behind a vtable is dropped",
        },
    ],
    panics: &[
        Panics {
            from: &["_defmt_"],
            to: &["core::panicking::panic_fmt"],
            task: LOGS,
            why: "the log asserts that it is not taken twice, and given back by who took it",
        },
        Panics {
            from: &["edm_store::", "<edm_store::", "sequential_storage::", "<&mut T as embedded_storage_async::"],
            to: &["core::"],
            task: "idle",
            why: "the library of the store: slices of a page, futures that might be polled after their end",
        },
        Panics {
            from: &["edm_hal_shim::stm32f4::can::start"],
            to: &["core::panicking::panic"],
            task: "idle",
            why: "start-up: bxcan checks the number of a filter",
        },
    ],
    recursions: &[Recursion {
        through: "rust_begin_unwind",
        why: "a panic of the log in the last words: the second time nothing is said (panic_handler::end)",
    }],
};

/// What was found.
#[derive(Debug, Default)]
pub struct Report {
    pub levels: Vec<Level>,
    /// Ways to a panic that may be, by why they may.
    pub panics: BTreeMap<&'static str, Vec<String>>,
    /// The deepest of start-up, bytes.
    pub starting: u32,
    /// The deepest that the stack can get, bytes.
    pub stack: u32,
}

/// Tasks that do not interrupt each other.
#[derive(Debug)]
pub struct Level {
    names: Vec<&'static str>,
    /// None: above all tasks.
    priority: Option<u8>,
    /// How many functions they can reach, and how many of those call what a register holds.
    functions: usize,
    indirect: usize,
    /// Bytes of the deepest, without the exception frame.
    stack: u32,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "  {:<44} {:>9} {:>9} {:>9}", "priority, tasks", "functions", "indirect", "stack")?;
        for Level { names, priority, functions, indirect, stack } in &self.levels {
            let priority = priority.map_or_else(|| "-".to_owned(), |priority| priority.to_string());
            let tasks = format!("{priority} {}", names.join(", "));
            writeln!(f, "  {tasks:<44} {functions:>9} {indirect:>9} {stack:>9}")?;
        }
        writeln!(f, "  {:<44} {:>29}", "  start-up, with interrupts masked", self.starting)?;
        writeln!(f, "  no task can panic, but:")?;
        for (why, ways) in &self.panics {
            writeln!(f, "    {why}:")?;
            ways.iter().try_for_each(|way| writeln!(f, "      {way}"))?;
        }
        Ok(())
    }
}

/// A task or a vector, and where it begins.
struct Root {
    name: &'static str,
    priority: Option<u8>,
    function: usize,
}

/// Reads of the graph what `rules` ask; `place` tells where in the source an address is.
///
/// # Errors
/// Each thing that is not as it must be.
pub fn check(graph: &Graph, rules: &Rules, place: &dyn Fn(u32) -> String) -> Result<Report, Vec<String>> {
    let mut check = Check { graph, place, calls: DiGraphMap::new(), errors: Vec::new() };
    let roots = check.roots(rules);
    check.calls(rules);
    let all: BTreeSet<usize> = roots.iter().flat_map(|root| check.reached(root.function).into_keys()).collect();
    check.unknown(&all, rules);
    let panics = check.panics(&roots, rules);
    check.recursions(&all, rules);
    check.fast(&roots, rules);
    let starting = check.depths()[graph.reset];
    check.start_is_over(rules);
    let depths = check.depths();

    let mut levels = BTreeMap::<_, Level>::new();
    for Root { name, priority, function } in roots {
        let reached = check.reached(function);
        let indirect = reached.keys().filter(|number| !graph.functions[**number].indirect.is_empty()).count();
        // Each of those that die may be interrupted by the next.
        let key = (priority.is_some(), std::cmp::Reverse(priority), if priority.is_none() { name } else { "" });
        let level = levels.entry(key).or_insert(Level { names: vec![], priority, functions: 0, indirect: 0, stack: 0 });
        level.names.push(name);
        level.functions = level.functions.max(reached.len());
        level.indirect = level.indirect.max(indirect);
        level.stack = level.stack.max(depths[function]);
    }
    let levels: Vec<Level> = levels.into_values().collect();
    let above = |dies: bool| {
        let above = levels.iter().filter(move |level| level.priority != Some(0) && (!dies || level.priority.is_none()));
        above.map(|level| level.stack + EXCEPTION).sum::<u32>()
    };
    let idle = levels.iter().filter(|level| level.priority == Some(0)).map(|level| level.stack).sum::<u32>();
    let stack = (idle + above(false)).max(starting + above(true));
    if check.errors.is_empty() { Ok(Report { levels, panics, starting, stack }) } else { Err(check.errors) }
}

struct Check<'a> {
    graph: &'a Graph,
    place: &'a dyn Fn(u32) -> String,
    /// All calls, those through registers as well.
    calls: DiGraphMap<usize, ()>,
    errors: Vec<String>,
}

impl Check<'_> {
    /// Every task and every other vector.
    fn roots(&mut self, rules: &Rules) -> Vec<Root> {
        let graph = self.graph;
        let mut vectors = graph.vectors.clone();
        let mut roots = Vec::new();
        let tasks = rules.tasks.iter().map(|task| (task.name, task.source, Some(task.priority)));
        for (name, source, priority) in tasks.chain(rules.dying.iter().map(|name| (*name, *name, None))) {
            let vector = match priority {
                Some(0) => Some(graph.reset),
                _ => vectors.iter().copied().find(|number| graph.is(*number, source)),
            };
            match vector {
                Some(function) => {
                    vectors.remove(&function);
                    roots.push(Root { name, priority, function });
                }
                None => self.errors.push(format!("{name}: no vector is {source}")),
            }
        }
        self.errors.extend(vectors.into_iter().map(|number| format!("the vector {} is no task", graph.name(number))));
        roots
    }

    /// Adds the calls that name their function, and those that `rules` know.
    fn calls(&mut self, rules: &Rules) {
        for (number, function) in self.graph.functions.iter().enumerate() {
            self.calls.add_node(number);
            for &(_, callee) in &function.calls {
                self.calls.add_edge(number, callee, ());
            }
            if function.indirect.is_empty() {
                continue;
            }
            for rule in rules.indirect.iter().filter(|rule| begins(&function.name, rule.from)) {
                for &callee in self.graph.taken.iter().filter(|callee| has(self.graph.name(**callee), rule.to)) {
                    self.calls.add_edge(number, callee, ());
                }
            }
        }
    }

    /// Unknown calls and stack pointers, among what can be reached; lines of `rules` that are not needed.
    fn unknown(&mut self, reached: &BTreeSet<usize>, rules: &Rules) {
        let mut errors = Vec::new();
        let callers = || reached.iter().map(|number| &self.graph.functions[*number]);
        for function in callers() {
            let known = rules.indirect.iter().any(|rule| begins(&function.name, rule.from));
            for at in function.indirect.iter().filter(|_| !known) {
                errors.push(format!("{} calls what a register holds, {}", function.name, (self.place)(*at)));
            }
            for at in &function.dynamic {
                let place = (self.place)(*at);
                errors.push(format!("{} sets the stack pointer to what a register holds, {place}", function.name));
            }
        }
        let taken = || self.graph.taken.iter().map(|number| self.graph.name(*number));
        for name in taken().filter(|name| !rules.indirect.iter().any(|rule| has(name, rule.to))) {
            errors.push(format!("the address of {name} is taken: who calls it?"));
        }
        for Indirect { from, to, why } in rules.indirect {
            let calls = |from: &str| callers().any(|f| !f.indirect.is_empty() && f.name.starts_with(from));
            errors.extend(
                from.iter().filter(|from| !calls(from)).map(|from| format!("no {from} left that calls: {why}")),
            );
            let is_taken = |to: &str| taken().any(|name| name.contains(to));
            errors.extend(to.iter().filter(|to| !is_taken(to)).map(|to| format!("no {to} left to be called: {why}")));
        }
        self.errors.extend(errors);
    }

    /// What can be reached from a function, each with the function before it; the first is its own.
    fn reached(&self, root: usize) -> BTreeMap<usize, usize> {
        self.reached_without(root, &BTreeSet::new())
    }

    /// The same, without going on from those in `ends`.
    fn reached_without(&self, root: usize, ends: &BTreeSet<usize>) -> BTreeMap<usize, usize> {
        let mut before = BTreeMap::from([(root, root)]);
        let mut next = VecDeque::from([root]);
        while let Some(number) = next.pop_front() {
            for callee in self.calls.neighbors(number).filter(|_| !ends.contains(&number)) {
                before.entry(callee).or_insert_with(|| {
                    next.push_back(callee);
                    number
                });
            }
        }
        before
    }

    /// Routines that panic: what leads to the handler without leaving `core`. What the compiler has taken out of several
    /// functions belongs to its callers.
    fn routines(&self) -> BTreeSet<usize> {
        let all = 0..self.graph.functions.len();
        let mut routines: BTreeSet<usize> = all
            .clone()
            .filter(|number| {
                self.graph.name(*number).starts_with("core::panicking::") || self.graph.is(*number, "rust_begin_unwind")
            })
            .collect();
        loop {
            let more = all.clone().filter(|number| {
                let calls = || self.calls.neighbors(*number).any(|callee| routines.contains(&callee));
                !routines.contains(number) && begins(self.graph.name(*number), &ROUTINES) && calls()
            });
            let more: Vec<usize> = more.collect();
            if more.is_empty() {
                return routines;
            }
            routines.extend(more);
        }
    }

    /// Where a function itself panics, and the routine: by a call, or by one that a register may hold.
    fn panics_in(&self, number: usize, routines: &BTreeSet<usize>) -> Vec<(u32, &str)> {
        let Function { calls, indirect, .. } = &self.graph.functions[number];
        let mut found = Vec::new();
        for callee in self.calls.neighbors(number).filter(|callee| routines.contains(callee)) {
            let direct: Vec<u32> = calls.iter().filter(|call| call.1 == callee).map(|call| call.0).collect();
            let places = if direct.is_empty() { indirect } else { &direct };
            found.extend(places.iter().map(|at| (*at, self.graph.name(callee))));
        }
        found
    }

    /// The ways to a panic that may be; the others are errors.
    fn panics(&mut self, roots: &[Root], rules: &Rules) -> BTreeMap<&'static str, Vec<String>> {
        let routines = self.routines();
        let most = |name| rules.tasks.iter().find(|task| task.name == name).map_or(0, |task| task.priority);
        let (mut ways, mut errors) = (BTreeMap::new(), Vec::new());
        for root in roots {
            let Some(priority) = root.priority else { continue };
            let reached = self.reached_without(root.function, &routines);
            for &caller in reached.keys().filter(|number| !routines.contains(number)) {
                let mut way = vec![caller];
                while let Some(number) = way.last().and_then(|last| reached.get(last)).filter(|n| !way.contains(n)) {
                    way.push(*number);
                }
                let way: Vec<_> = way.iter().rev().map(|number| self.graph.name(*number)).collect();
                let way = format!("{}: {}", root.name, way.join(" > "));
                for (at, routine) in self.panics_in(caller, &routines) {
                    let may = rules.panics.iter().filter(|rule| priority <= most(rule.task) && has(routine, rule.to));
                    let mut may = may.flat_map(|rule| rule.from.iter().map(move |from| (*from, rule)));
                    match may.find(|(from, _)| self.graph.name(caller).starts_with(from)) {
                        Some((from, rule)) => {
                            ways.entry((from, root.name)).or_insert((rule.why, way.clone()));
                        }
                        None => errors.push(format!("a panic in {way} > {routine}, {}", (self.place)(at))),
                    }
                }
            }
        }
        for Panics { from, task, why, .. } in rules.panics {
            for from in from.iter().filter(|from| !ways.contains_key(&(**from, *task))) {
                errors.push(format!("{task} reaches no panic of {from} any more: {why}"));
            }
        }
        self.errors.extend(errors);
        let mut panics = BTreeMap::<_, Vec<_>>::new();
        ways.into_values().for_each(|(why, way)| panics.entry(why).or_default().push(way));
        panics
    }

    /// What calls itself ends, for a reason that is in a line.
    fn recursions(&mut self, reached: &BTreeSet<usize>, rules: &Rules) {
        let mut stale: Vec<_> = rules.recursions.iter().collect();
        for round in tarjan_scc(&self.calls) {
            let recursive = round.len() > 1 || self.calls.contains_edge(round[0], round[0]);
            if !recursive || !reached.contains(&round[0]) {
                continue;
            }
            let ends = |rule: &&Recursion| round.iter().any(|number| self.graph.is(*number, rule.through));
            if rules.recursions.iter().any(|rule| ends(&rule)) {
                stale.retain(|rule| !ends(rule));
            } else {
                let names: Vec<_> = round.iter().map(|number| self.graph.name(*number)).collect();
                self.errors.push(format!("recursion: {}", names.join(", ")));
            }
        }
        let stale = stale.iter().map(|rule| format!("no recursion through {} any more: {}", rule.through, rule.why));
        self.errors.extend(stale);
    }

    /// What runs often lies in RAM; what dies with a stack that has reached its guard does not lie where that stack goes on.
    fn fast(&mut self, roots: &[Root], rules: &Rules) {
        let Some(least) = rules.fast else { return };
        let mut wrong = BTreeSet::new();
        for Root { name, priority, function } in roots {
            for number in self.reached(*function).into_keys() {
                let Function { name: callee, fast, thunk, .. } = &self.graph.functions[number];
                match (priority, fast) {
                    (None, true) => {
                        wrong.insert(format!(
                            "{name} reaches {callee}, over which its stack may grow: not in .fast (memory.x)"
                        ));
                    }
                    (Some(priority), false) if *priority >= least && !thunk && !has(callee, rules.flash) => {
                        wrong.insert(format!(
                            "{name} reaches {callee}, which lies in flash: name it in memory.x, in .fast"
                        ));
                    }
                    _ => {}
                }
            }
        }
        self.errors.extend(wrong);
    }

    /// Takes away what start-up has called before it enabled interrupts.
    fn start_is_over(&mut self, rules: &Rules) {
        for name in rules.starts {
            let found: Vec<usize> = self.calls.nodes().filter(|number| self.graph.is(*number, name)).collect();
            if found.is_empty() {
                self.errors.push(format!("no function is {name}: where are interrupts enabled?"));
            }
            for number in found {
                let callees: Vec<usize> = self.calls.neighbors(number).collect();
                callees.into_iter().for_each(|callee| {
                    self.calls.remove_edge(number, callee);
                });
            }
        }
    }

    /// The deepest stack of each function with those that it calls, bytes.
    fn depths(&self) -> Vec<u32> {
        let mut depths = vec![0; self.graph.functions.len()];
        // Those that are called come before those that call.
        for round in tarjan_scc(&self.calls) {
            let outside = round.iter().flat_map(|number| self.calls.neighbors(*number));
            let below = outside.map(|callee| depths[callee]).max().unwrap_or(0);
            let frames: u32 = round.iter().map(|number| self.graph.functions[*number].frame).sum();
            round.iter().for_each(|number| depths[*number] = frames + below);
        }
        depths
    }
}

/// Whether a name begins with one of `beginnings`.
fn begins(name: &str, beginnings: &[&str]) -> bool {
    beginnings.iter().any(|beginning| name.starts_with(beginning))
}

/// Whether one of `parts` is in a name.
fn has(name: &str, parts: &[&str]) -> bool {
    parts.iter().any(|part| name.contains(part))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use std::process::Command;

    /// What stands for all routines that panic.
    const PANIC: (&str, &str) = ("core::panicking::panic_fmt", "b .");

    /// Assembles and links functions, each a name and its instructions; `data` is what else there is. The vectors are those of
    /// `RULES`, whose functions do nothing unless they are given.
    fn image(functions: &[(&str, &str)], data: &str) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let nothing = ["Reset", "TIM1", "SPI3", "HardFault"].map(|name| (name, "bx lr"));
        let given = |name| functions.iter().any(|function| function.0 == name);
        let mut text = ".syntax unified\n.thumb\n".to_owned();
        for (name, code) in functions.iter().chain(nothing.iter().filter(|function| !given(function.0))) {
            text += &format!(
                ".type \"{name}\", %function\n.thumb_func\n\"{name}\":\n{code}\n.size \"{name}\", . - \"{name}\"\n"
            );
            text += ".ltorg\n.balign 4\n";
        }
        text +=
            ".section .vectors, \"a\"\n.word 0x20008000, Reset, HardFault, TIM1, 0, SPI3\n.section .rodata, \"a\"\n";
        std::fs::write(folder.path().join("code.s"), text + data + "\n").unwrap();
        let program = "#![no_std]\n#![no_main]\n#[panic_handler]\nfn panic(_: &core::panic::PanicInfo) -> ! { loop {} }\n\
                       core::arch::global_asm!(include_str!(\"code.s\"), options(raw));\n";
        std::fs::write(folder.path().join("program.rs"), program).unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware/link.x");
        let built = Command::new("rustc")
            .args(["--edition", "2024", "--target", super::super::TARGET, "-Cpanic=abort"])
            .args(["-Clink-arg=--emit-relocs".into(), format!("-Clink-arg=-T{}", script.display())])
            .args(["-o", "elf", "program.rs"])
            .current_dir(&folder)
            .output()
            .expect("rustc runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
        std::fs::read(folder.path().join("elf")).unwrap()
    }

    const RULES: Rules = Rules {
        tasks: &[
            Task { name: "servo", priority: 2, source: "TIM1", deadline: "" },
            Task { name: "protocol", priority: 1, source: "SPI3", deadline: "" },
            Task { name: "idle", priority: 0, source: "-", deadline: "" },
        ],
        dying: &["HardFault"],
        starts: &[],
        fast: None,
        flash: &[],
        indirect: &[],
        panics: &[],
        recursions: &[],
    };

    fn checked(image: &[u8], rules: &Rules) -> Result<Report, String> {
        let file = object::File::parse(image).unwrap();
        check(&Graph::read(&file)?, rules, &|at| format!("at {at:#x}")).map_err(|errors| errors.join("\n"))
    }

    /// The check refuses it, and says `words`.
    fn refused(image: &[u8], rules: &Rules, words: &str) {
        let said = checked(image, rules).expect_err(words);
        assert!(said.contains(words), "{said}");
    }

    const METHOD: Indirect = Indirect { from: &["TIM1"], to: &["method"], why: "of the test" };

    #[test]
    fn a_panic_is_found_however_it_is_reached() {
        let call = r#"bl "core::panicking::panic_fmt""#;
        let method = [("method", call), PANIC];
        for (how, code, data) in [
            ("a call", "push {r7, lr}\nbl method\npop {r7, pc}", ""),
            ("a jump at the end", "b.w method", ""),
            ("a short jump at the end", "b method", ""),
            ("a condition", "cmp r0, #1\nbeq.w method\nbx lr", ""),
            ("a short condition", "cbz r0, method\nbx lr", ""),
            ("falling out of the end", "movs r0, #1", ""),
            (
                "an arm of a long jump table",
                "adr r0, 0f\nmov pc, r0\n.balign 4\n0: b.w 1f\nb.w 2f\n1: bx lr\n2: bl method",
                "",
            ),
            (
                "an arm of a jump table",
                "tbb [pc, r0]\n0: .byte (1f - 0b) / 2, (2f - 0b) / 2\n1: bx lr\n2: bl method",
                "",
            ),
            ("a table of methods", "ldr r0, =table\nldr r0, [r0, #12]\nbx r0", "table: .word 0, 4, 4, method"),
            ("a word among the code", "push {lr}\nldr r0, =method\nblx r0\npop {pc}", ""),
            ("two halves of an address", "movw r2, #:lower16:method\nmovt r2, #:upper16:method\nbx r2", ""),
        ] {
            let image = image(&[&[("TIM1", code)], &method[..]].concat(), data);
            let known = checked(&image, &RULES).is_err_and(|said| said.contains("what a register holds"));
            let rules = Rules { indirect: if known { &[METHOD] } else { &[] }, ..RULES };
            let said = checked(&image, &rules).expect_err(how);
            assert!(
                said.contains("a panic in servo: TIM1 > method > core::panicking::panic_fmt, at 0x"),
                "{how}: {said}"
            );
            assert_eq!(said.lines().count(), 1, "{how}: {said}");
        }
    }

    #[test]
    fn routines_of_core_that_lead_to_a_panic_are_named_themselves() {
        let image = image(
            &[
                ("TIM1", "b \"core::slice::index::slice_index_fail\""),
                ("core::slice::index::slice_index_fail", "bl \"core::panicking::panic_fmt\""),
                PANIC,
            ],
            "",
        );
        refused(&image, &RULES, "a panic in servo: TIM1 > core::slice::index::slice_index_fail");
    }

    #[test]
    fn a_routine_in_a_register_is_a_panic_too() {
        let register = image(&[("TIM1", "ldr r0, =\"core::panicking::panic_fmt\"\nbx r0"), PANIC], "");
        let rules = Rules { indirect: &[Indirect { to: &["core::panicking::"], ..METHOD }], ..RULES };
        refused(&register, &rules, "a panic in servo: TIM1 > core::panicking::panic_fmt, at 0x");
    }

    #[test]
    fn who_may_panic_may_no_higher_up_and_only_as_long_as_it_does() {
        const LOG: Panics = Panics { from: &["log"], to: &["_fmt"], task: "protocol", why: "it asserts" };
        let rules = Rules { panics: &[LOG], ..RULES };
        let log = ("log_line", "bl \"core::panicking::panic_fmt\"");
        let said = checked(&image(&[("SPI3", "b.w log_line"), log, PANIC], ""), &rules).unwrap().to_string();
        assert!(said.ends_with("  it asserts:\n      protocol: SPI3 > log_line\n"), "{said}");
        refused(
            &image(&[("TIM1", "b.w log_line"), ("SPI3", "b.w log_line"), log, PANIC], ""),
            &rules,
            "a panic in servo",
        );
        let other = [
            ("SPI3", "b.w log_line"),
            ("log_line", "bl \"core::panicking::panic\""),
            ("core::panicking::panic", "b ."),
        ];
        refused(&image(&other, ""), &rules, "a panic in protocol: SPI3 > log_line > core::panicking::panic, ");
        refused(&image(&[("Reset", "b.w log_line"), log, PANIC], ""), &rules, "protocol reaches no panic of log");
        refused(
            &image(&[("SPI3", "bl \"core::panicking::panic_fmt\""), PANIC], ""),
            &rules,
            "a panic in protocol: SPI3 >",
        );
    }

    #[test]
    fn a_call_to_nobody_knows_where_is_refused_and_so_are_lines_that_nothing_needs() {
        let rules = Rules { indirect: &[METHOD], ..RULES };
        let functions = [("TIM1", "bx r3"), ("method", "bx lr"), ("other", "bx lr")];
        assert!(checked(&image(&functions, ".word method"), &rules).is_ok());
        refused(&image(&functions, ".word method"), &RULES, "TIM1 calls what a register holds, at 0x");
        refused(&image(&functions, ".word method, other"), &rules, "the address of other is taken");
        refused(&image(&functions, ""), &rules, "no method left to be called: of the test");
        refused(&image(&functions[1..], ".word method"), &rules, "no TIM1 left that calls: of the test");
        for jump in ["mov pc, r0", "ldr pc, [r0]", "ldmia r0, {r1, pc}"] {
            refused(&image(&[("TIM1", jump)], ""), &RULES, "TIM1 calls what a register holds");
        }
    }

    #[test]
    fn a_stack_of_unknown_size_is_refused() {
        for code in ["sub sp, sp, r0", "mov sp, r4", "add sp, r0", "msr msp, r0"] {
            refused(&image(&[("TIM1", &format!("{code}\nbx lr"))], ""), &RULES, "TIM1 sets the stack pointer");
        }
    }

    #[test]
    fn a_recursion_is_refused_unless_it_is_known_to_end() {
        let known = Rules { recursions: &[Recursion { through: "there", why: "it stops" }], ..RULES };
        let there = ("there", "push {r7, lr}\nbl back\npop {r7, pc}");
        let round = image(&[("SPI3", "b there"), there, ("back", "push {r4-r6, lr}\nbl there\npop {r4-r6, pc}")], "");
        refused(&round, &RULES, "recursion: ");
        // Both frames, once.
        assert_eq!(checked(&round, &known).unwrap().stack, 8 + 16 + 3 * EXCEPTION);
        refused(
            &image(&[("there", "push {r7, lr}\nbl there\npop {r7, pc}"), ("TIM1", "b there")], ""),
            &RULES,
            "recursion",
        );
        refused(&image(&[], ""), &known, "no recursion through there any more: it stops");
    }

    #[test]
    fn the_deepest_of_every_priority_adds_up() {
        let image = image(
            &[
                ("Reset", "push {r4, lr}\nsub sp, #8\nbl shallow\nbl deep\nb ."),
                ("TIM1", "push.w {r4-r8, lr}\nvpush {d8-d9}\nbl shallow\nvpop {d8-d9}\npop.w {r4-r8, pc}"),
                ("SPI3", "str r7, [sp, #-4]!\nb.w deep"),
                ("HardFault", "b shallow"),
                ("shallow", "sub sp, #4\nadd sp, #4\nbx lr"),
                ("deep", "sub.w sp, sp, #1024\nadd.w sp, sp, #1024\nbx lr"),
            ],
            "",
        );
        let report = checked(&image, &RULES).unwrap();
        let stacks: Vec<_> = report.levels.iter().map(|level| (level.names[0], level.stack)).collect();
        assert_eq!(stacks, [("HardFault", 4), ("servo", 24 + 16 + 4), ("protocol", 4 + 1024), ("idle", 16 + 1024)]);
        assert_eq!(report.stack, 4 + 44 + 1028 + 1040 + 3 * EXCEPTION);
    }

    #[test]
    fn nothing_but_a_fault_comes_on_top_of_what_start_up_calls() {
        let rules = Rules { starts: &["starts"], ..RULES };
        let functions = [
            ("Reset", "push {r4, lr}\nbl starts\nbl idle\nb ."),
            ("starts", "push {r4, lr}\nsub sp, #16\nbl deep\nadd sp, #16\npop {r4, pc}"),
            ("idle", "sub sp, #4\nadd sp, #4\nbx lr"),
            ("TIM1", "sub sp, #32\nadd sp, #32\nbx lr"),
            ("deep", "sub.w sp, sp, #1024\nadd.w sp, sp, #1024\nbx lr"),
        ];
        let report = checked(&image(&functions, ""), &rules).unwrap();
        assert_eq!((report.starting, report.stack), (8 + 24 + 1024, 8 + 24 + 1024 + EXCEPTION));
        // Without deep calls it is the tasks: its own frame stays while interrupts are on.
        let functions = functions.map(|(name, code)| (name, if name == "deep" { "bx lr" } else { code }));
        let report = checked(&image(&functions, ""), &rules).unwrap();
        assert_eq!((report.starting, report.stack), (32, 8 + 24 + 32 + 3 * EXCEPTION));
        refused(&image(&[], ""), &rules, "no function is starts");
    }

    #[test]
    fn vectors_and_tasks_are_the_same() {
        let image = image(&[], "");
        assert!(checked(&image, &RULES).is_ok());
        refused(&image, &Rules { dying: &[], ..RULES }, "the vector HardFault is no task");
        refused(&image, &Rules { dying: &["HardFault", "NMI"], ..RULES }, "NMI: no vector is NMI");
    }
}
