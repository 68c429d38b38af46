//! Batch script. Every path in it is quoted for `sbatch` and for the shell.

use super::{PROGRAM_MISSING, SlurmRequest, SweepError};
use crate::sweep::{Runner, SweptCommand, point::quoted};
use std::path::Path;

/// Script of every array of a sweep in `root`, with the first line and the list as arguments.
///
/// # Errors
/// When a path has a line break.
pub fn batch_script(
    root: &Path,
    runner: &Runner,
    request: &SlurmRequest,
    command: SweptCommand,
) -> Result<String, SweepError> {
    let log = root.join(super::SLURM).join("log");
    let cores = request.cores.unwrap_or(1);
    let mut directives = vec![
        format!("--job-name=klasktron-{}", command.name()),
        format!("--chdir={}", for_sbatch(&runner.working_folder)?),
        // %A_%a: array and task.
        format!("--output={}", for_sbatch_pattern(&log, "/%A_%a.log")?),
        "--ntasks=1".to_owned(),
        format!("--cpus-per-task={cores}"),
    ];
    let asked = [("partition", &request.partition), ("time", &request.time), ("mem", &request.mem)];
    for (name, value) in asked {
        if let Some(value) = value {
            directives.push(format!("--{name}={}", in_double_quotes(value)));
        }
    }
    let is_directive = |line: &&String| line.starts_with('-') || line.starts_with("#SBATCH");
    let stripped = |line: &String| line.trim_start_matches("#SBATCH").trim().to_owned();
    directives.extend(request.lines.iter().filter(is_directive).map(stripped));
    let mut text = "#!/bin/bash\n".to_owned();
    for directive in directives {
        text.push_str(&format!("#SBATCH {directive}\n"));
    }
    for line in request.lines.iter().filter(|line| !is_directive(line)) {
        text.push_str(&format!("{line}\n"));
    }
    let program = for_shell(&runner.program)?;
    let (root, log) = (for_shell(root)?, for_shell(&log)?);
    text.push_str(&format!(
        r#"
# Arguments: the first line of this array in the list of points, and the list.
program={program}
task="${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
if [ ! -x "$program" ]; then
    echo "error: $program is not on node $(hostname), or not executable" >&2
    status={PROGRAM_MISSING}
else
    "$program" --no-config sweep-task --output {root} --list "$2" --line "$(($1 + SLURM_ARRAY_TASK_ID))" \
        --task "$task" --threads {cores} < /dev/null
    status=$?
fi
echo "$status" > {log}/"$task.exit"
exit "$status"
"#
    ));
    Ok(text)
}

/// First part of `request` that a batch script cannot contain: lines with breaks, empty words.
#[must_use]
pub fn request_faults(request: &SlurmRequest) -> Option<String> {
    let words = [&request.partition, &request.time, &request.mem];
    let bad = |word: &&String| word.is_empty() || word.contains(['\n', '\r', '\0']);
    let found = words.into_iter().flatten().chain(&request.lines).find(bad)?;
    Some(format!("'{}' is empty or has a line break", found.escape_debug()))
}

fn for_shell(path: &Path) -> Result<String, SweepError> {
    Ok(quoted(one_line(path)?))
}

fn for_sbatch(path: &Path) -> Result<String, SweepError> {
    Ok(in_double_quotes(one_line(path)?))
}

/// A path for `sbatch`: percent signs of the folder are escaped, `pattern` is appended as it is.
fn for_sbatch_pattern(path: &Path, pattern: &str) -> Result<String, SweepError> {
    Ok(in_double_quotes(&format!("{}{pattern}", one_line(path)?.replace('%', "%%"))))
}

fn in_double_quotes(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

fn one_line(path: &Path) -> Result<&str, SweepError> {
    path.to_str()
        .filter(|text| !text.contains(['\n', '\r']))
        .ok_or_else(|| SweepError::PathForScript { path: path.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directives_come_first_and_every_path_is_quoted() {
        let runner = Runner {
            program: "/opt/it's here/klasktron".into(),
            working_folder: "/data/a b".into(),
            threads: 1,
            task: None,
        };
        let request = SlurmRequest {
            partition: Some("main".to_owned()),
            cores: Some(2),
            lines: ["module load gcc", "--gres=gpu:1", "#SBATCH --nice"]
                .map(str::to_owned)
                .to_vec(),
            ..SlurmRequest::default()
        };
        let text =
            batch_script(Path::new("/out/50 %"), &runner, &request, SweptCommand::Train).unwrap();
        let head: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).collect();
        assert_eq!(
            head,
            [
                "#!/bin/bash",
                "#SBATCH --job-name=klasktron-train",
                "#SBATCH --chdir=\"/data/a b\"",
                "#SBATCH --output=\"/out/50 %%/slurm/log/%A_%a.log\"",
                "#SBATCH --ntasks=1",
                "#SBATCH --cpus-per-task=2",
                "#SBATCH --partition=\"main\"",
                "#SBATCH --gres=gpu:1",
                "#SBATCH --nice",
                "module load gcc",
            ]
        );
        assert!(text.contains("program='/opt/it'\\''s here/klasktron'\n"), "{text}");
        assert!(text.contains("sweep-task --output '/out/50 %' --list \"$2\""), "{text}");
    }

    #[test]
    fn a_line_break_is_refused() {
        let broken = SlurmRequest { time: Some("1\n2".to_owned()), ..SlurmRequest::default() };
        assert!(request_faults(&broken).unwrap().contains("1\\n2"));
        assert_eq!(request_faults(&SlurmRequest::default()), None);
    }
}
