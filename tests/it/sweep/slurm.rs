//! The Slurm engine before a Slurm that does what the test says: `sbatch` runs tasks at once, `squeue` says
//! what it is told.

use super::support::{Bench, files, finished, made};
use crate::support::said;
use std::{
    fs,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
};

/// Programs called `sbatch`, `squeue` and `scontrol`, and what they remember.
pub(super) struct FakeSlurm {
    pub(super) folder: PathBuf,
}

/// Runs every task but those in `skip` (lines of task, state, exit code), and remembers how it ended.
const SBATCH: &str = r#"#!/bin/bash
fake="$(dirname "$0")"
printf '%s\n' "$*" >> "$fake/calls"
if [ -e "$fake/refuse" ]; then cat "$fake/refuse" >&2; exit 1; fi
for word in "$@"; do case "$word" in --array=0-*) last="${word#--array=0-}" ;; esac; done
job=$(( $(cat "$fake/job" 2> /dev/null || echo 100) + 1 ))
echo "$job" > "$fake/job"
args=("$@")
script="${args[2]}"
log="$(dirname "$script")/log"
cd "$(sed -n 's/^#SBATCH --chdir="\(.*\)"$/\1/p' "$script")" || exit 1
for task in $(seq 0 "$last"); do
    skipped="$(grep "^$task " "$fake/skip" 2> /dev/null)"
    if [ -n "$skipped" ]; then
        echo "$job $skipped 0 Fake" >> "$fake/states"
    else
        SLURM_ARRAY_JOB_ID=$job SLURM_ARRAY_TASK_ID=$task \
            bash "$script" "${args[3]}" "${args[4]}" > "$log/${job}_$task.log" 2>&1
        status=$?
        if [ $status = 0 ]; then state=COMPLETED; else state=FAILED; fi
        echo "$job $task $state $((status * 256)) 0 None" >> "$fake/states"
    fi
done
rm -f "$fake/skip"
echo "$job"
"#;
const SQUEUE: &str = "#!/bin/bash\ncat \"$(dirname \"$0\")/states\" 2> /dev/null\nexit 0\n";
const SCONTROL: &str =
    "#!/bin/bash\necho 'MaxArraySize            = 5'\necho 'MaxJobCount = 10000'\n";

impl FakeSlurm {
    pub(super) fn new(bench: &Path) -> Self {
        let folder = bench.join("fake slurm");
        fs::create_dir(&folder).unwrap();
        for (name, text) in [("sbatch", SBATCH), ("squeue", SQUEUE), ("scontrol", SCONTROL)] {
            let path = folder.join(name);
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        Self { folder }
    }

    /// The path on which its programs are found first.
    pub(super) fn path(&self) -> String {
        format!("{}:{}", self.folder.display(), std::env::var("PATH").unwrap())
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.join(name), text).unwrap();
    }

    fn calls(&self) -> Vec<String> {
        let text = fs::read_to_string(self.folder.join("calls")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }

    fn run(&self, bench: &Bench, out: &Path, more: &[&str]) -> (String, String, i32) {
        let mut command = bench.command(out, &["--engine", "slurm"]);
        said(&command.args(more).env("PATH", self.path()).output().unwrap())
    }
}

#[test]
fn arrays_keep_to_the_limit_and_the_results_are_those_of_a_local_run() {
    let bench = Bench::new(12, "");
    let fake = FakeSlurm::new(&bench.folder());
    let [out, local] = ["slurm out", "local"].map(|name| bench.out(name));
    let (_, stderr, status) = fake.run(&bench, &out, &[]);
    assert_eq!(status, 0, "{stderr}");
    let arrays: Vec<String> = fake.calls();
    assert_eq!(arrays.len(), 3, "{arrays:?}");
    for (call, (array, offset)) in arrays.iter().zip([("0-4", 0), ("0-4", 5), ("0-1", 10)]) {
        assert!(call.starts_with(&format!("--parsable --array={array} ")), "{call}");
        assert!(call.contains(&format!("sweep.sbatch {offset} ")), "{call}");
    }
    assert_eq!(bench.run(&local, &[]).2, 0);
    assert!(files(&out) == files(&local), "Slurm and local runs differ");
    // Once more: nothing is submitted.
    let before = made(&out);
    assert_eq!(fake.run(&bench, &out, &[]).2, 0);
    assert_eq!(fake.calls().len(), 3);
    assert_eq!(made(&out), before);
}

#[test]
fn a_task_without_a_result_is_named_with_the_way_out_and_retried_when_asked() {
    for (skip, part) in [
        ("1 TIMEOUT 15", "time limit exceeded; request more with --time and --retry"),
        ("1 OUT_OF_MEMORY 9", "--mem"),
        ("1 NODE_FAIL 256", "node failure; --retry"),
        ("1 CANCELLED 15", ": cancelled"),
        ("1 FAILED 9", ": killed by signal 9"),
        ("1 FAILED 7168", "the disk of the results is full"),
    ] {
        let bench = Bench::new(3, "");
        let fake = FakeSlurm::new(&bench.folder());
        let out = bench.out("out");
        fake.write("skip", &format!("{skip}\n"));
        let (_, stderr, status) = fake.run(&bench, &out, &[]);
        assert_eq!(status, 3, "{stderr}");
        assert!(
            stderr.contains(part) && stderr.contains("task 101_1 (seed 1)"),
            "{skip}: {stderr}"
        );
        assert!(stderr.contains("slurm/log/101_1.log"), "{stderr}");
        let before = made(&out);
        assert_eq!(before.len(), 2);
        // It stays as it is until somebody asks.
        assert_eq!(fake.run(&bench, &out, &[]).2, 3);
        assert_eq!(fake.calls().len(), 1);
        let (_, stderr, status) = fake.run(&bench, &out, &["--retry"]);
        assert_eq!(status, 0, "{stderr}");
        assert_eq!(fake.calls().len(), 2);
        assert!(before.iter().all(|(name, when)| made(&out)[name] == *when));
    }
}

#[test]
fn the_submitting_process_may_leave_and_come_back() {
    let bench = Bench::new(3, "");
    let fake = FakeSlurm::new(&bench.folder());
    let out = bench.out("out");
    fake.write("skip", "1 RUNNING 0\n2 PENDING 0\n");
    let mut command = bench.command(&out, &["--engine", "slurm"]);
    let stderr_file = bench.out("stderr");
    let mut child = command
        .env("PATH", fake.path())
        .stdout(std::process::Stdio::null())
        .stderr(fs::File::create(&stderr_file).unwrap())
        .spawn()
        .unwrap();
    let stderr = || fs::read_to_string(&stderr_file).unwrap();
    while !stderr().contains("1 of 3 points finished, 1 running, 1 waiting (Fake)") {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let pid = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130), "{}", stderr());
    let said =
        "2 tasks remain with Slurm; the same command continues; cancel them with: scancel 101";
    assert!(stderr().contains(said), "{}", stderr());
    // A local run would do the work twice.
    let mut here = bench.command(&out, &[]);
    let (_, refused, status) =
        crate::support::said(&here.env("PATH", fake.path()).output().unwrap());
    assert_eq!(status, 1, "{refused}");
    assert!(refused.contains("2 tasks of this sweep are in Slurm's queue"), "{refused}");
    // Meanwhile the tasks have come to their end: both failed by Slurm's account.
    fake.write(
        "states",
        "101 0 COMPLETED 0 0 None\n101 1 TIMEOUT 15 0 TimeLimit\n101 2 NODE_FAIL 1 0 None\n",
    );
    let (_, told, status) = fake.run(&bench, &out, &["--retry"]);
    assert_eq!(status, 0, "{told}");
    assert_eq!(fake.calls().len(), 2);
    assert_eq!(finished(&out).len(), 3);
}

#[test]
fn what_slurm_refuses_is_told_in_its_own_words() {
    let bench = Bench::new(2, "");
    let fake = FakeSlurm::new(&bench.folder());
    fake.write("refuse", "sbatch: error: invalid partition specified: nope\n");
    let (_, stderr, status) = fake.run(&bench, &bench.out("out"), &["--partition", "nope"]);
    assert_eq!(status, 1);
    assert!(stderr.contains("sbatch failed: sbatch: error: invalid partition"), "{stderr}");
    let mut command = bench.command(&bench.out("none"), &["--engine", "slurm"]);
    let (_, stderr, status) = said(&command.env("PATH", "/nowhere").output().unwrap());
    assert_eq!(status, 1);
    assert!(stderr.contains("is Slurm installed here? --engine local needs none"), "{stderr}");
}

#[test]
fn a_dry_run_prints_the_script_and_submits_nothing() {
    let bench = Bench::new(2, "[slurm]\ntime = \"10\"\nlines = [\"module load x\"]\n");
    let fake = FakeSlurm::new(&bench.folder());
    let out = bench.out("out");
    let more = ["--dry-run", "--time", "20", "--sbatch-line=--gres=gpu:1"];
    let (stdout, stderr, status) = fake.run(&bench, &out, &more);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.starts_with("#!/bin/bash\n#SBATCH --job-name=klasktron-eval\n"), "{stdout}");
    for part in ["--time=\"20\"\n", "#SBATCH --gres=gpu:1\n", "2 points, of which 0 are finished"] {
        assert!(stdout.contains(part), "{stdout}");
    }
    // The command line's lines stand for those of the file.
    assert!(!stdout.contains("module load"), "{stdout}");
    assert!(fake.calls().is_empty() && !out.exists());
}
