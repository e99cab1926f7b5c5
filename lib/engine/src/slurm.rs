//! SLURM: `sbatch`, `squeue`, `scontrol`, `scancel`.
//!
//! A controller that crashes forgets the last ids that it gave, and gives them again. So the queue is asked for names,
//! each of which is noted before anything is submitted under it, and never for ids that were noted.

use std::collections::HashSet;
use std::env;
use std::fs;
use std::io;
use std::path::Path;
use std::process;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail, ensure};
use gl_case::Cluster;

use crate::Say;
use crate::command::{Caller, Programs, Said};
use crate::scheduler::{Job, Log, NoAnswer, Noted, Patience, Request, Scheduler};

/// SLURM's own default for `MaxArraySize`.
const ARRAY_SIZE: usize = 1001;
/// Nodes that a message names.
const NODES: usize = 5;

/// SLURM with the options of a site.
pub struct Slurm<C = Programs> {
    caller: C,
    patience: Patience,
    options: Vec<String>,
}

impl Slurm {
    /// With what the site wants of a job.
    pub fn new(cluster: &Cluster, patience: Patience) -> Self {
        Self::with(Programs, cluster, patience)
    }
}

impl<C: Caller> Slurm<C> {
    fn with(caller: C, cluster: &Cluster, patience: Patience) -> Self {
        let mut options = vec![format!("--cpus-per-task={}", cluster.threads)];
        for (key, value) in [
            ("partition", &cluster.partition),
            ("account", &cluster.account),
            ("qos", &cluster.qos),
            ("time", &cluster.time),
            ("mem", &cluster.mem),
        ] {
            options.extend(value.iter().map(|value| format!("--{key}={value}")));
        }
        Self { caller, patience, options }
    }

    fn call(&self, program: &str, arguments: &[String]) -> io::Result<Said> {
        self.caller.call(program, arguments, self.patience.limit)
    }

    /// Ask until there is an answer, or patience ends.
    fn ask(&self, program: &str, arguments: &[String]) -> Result<String> {
        let mut pauses = self.patience.pauses.iter();
        loop {
            let problem = match self.call(program, arguments) {
                Ok(said) if said.is_success => return Ok(said.stdout),
                Ok(said) => said.stderr,
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    bail!(NoAnswer(format!("{program} is not installed here")));
                }
                Err(error) => error.to_string(),
            };
            let Some(&pause) = pauses.next() else {
                bail!(NoAnswer(problem.lines().next().unwrap_or_default().to_owned()));
            };
            self.caller.pause(std::time::Duration::from_secs(pause));
        }
    }

    /// Nodes that take no jobs, as `name, state, reason`, and whether there are others that do.
    fn nodes(&self, partition: Option<&str>) -> (Vec<[String; 3]>, bool) {
        let mut arguments = strings(["--noheader", "--Node", "--format=%N|%T|%E"]);
        arguments.extend(partition.map(|name| format!("--partition={name}")));
        let Ok(Said { is_success: true, stdout, .. }) = self.call("sinfo", &arguments) else {
            return (Vec::new(), true);
        };
        parse_nodes(&stdout)
    }
}

impl<C: Caller> Scheduler for Slurm<C> {
    fn engine(&self) -> &'static str {
        "slurm"
    }

    fn check(&self) -> Result<()> {
        let version = self.call("sbatch", &strings(["--version"]));
        ensure!(
            !version.is_err_and(|error| error.kind() == io::ErrorKind::NotFound),
            "sbatch is not installed; is this a login node of a SLURM cluster?"
        );
        Ok(())
    }

    fn largest_array(&self) -> Option<usize> {
        let config = self.call("scontrol", &strings(["show", "config"]));
        Some(config.ok().and_then(|said| parse_array_size(&said.stdout)).unwrap_or(ARRAY_SIZE))
    }

    fn follows_arrays(&self) -> bool {
        true
    }

    fn array_name(&self, first: usize) -> String {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        format!("gl-{}-{}-{first}", now.as_millis(), process::id())
    }

    fn control_name(&self, out: &Path) -> String {
        let folder = fs::canonicalize(out).unwrap_or_else(|_| out.to_owned());
        format!("gl-control-{:016x}", fingerprint(folder.as_os_str().as_encoded_bytes()))
    }

    fn own_job(&self) -> Option<String> {
        env::var("SLURM_JOB_ID").ok()
    }

    fn submit(&self, request: &Request, say: Say) -> Result<String> {
        let arguments = arguments(request, &self.options);
        let mut pauses = self.patience.pauses.iter();
        loop {
            let problem = match self.call("sbatch", &arguments) {
                Ok(said) if said.is_success => {
                    let (id, warnings) = parse_submission(&said.stdout);
                    tell(&format!("{warnings}{}", said.stderr), say);
                    return id.with_context(|| format!("sbatch gave no job id: {:?}", said.stdout));
                }
                Ok(said) => {
                    // What is wrong with a job stays wrong.
                    ensure!(is_passing(&said.stderr), "sbatch refused: {}", said.stderr.trim());
                    said.stderr
                }
                Err(error) if error.kind() == io::ErrorKind::TimedOut => error.to_string(),
                Err(error) => return Err(error).context("sbatch"),
            };
            let Some(&pause) = pauses.next() else {
                bail!(NoAnswer(problem.trim().to_owned()));
            };
            self.caller.pause(std::time::Duration::from_secs(pause));
            // It may have been taken although the answer was lost.
            let taken = self.queued(&[Noted { name: request.name.to_owned(), id: None }])?;
            if let Some(job) = taken.first() {
                return Ok(job.id.clone());
            }
        }
    }

    fn queued(&self, noted: &[Noted]) -> Result<Vec<Job>> {
        if noted.is_empty() {
            return Ok(Vec::new());
        }
        let names: Vec<&str> = noted.iter().map(|it| it.name.as_str()).collect();
        let mut arguments = strings(["--noheader", "--format=%F|%i|%j|%T|%r"]);
        arguments.push(format!("--name={}", names.join(",")));
        Ok(parse_queue(&self.ask("squeue", &arguments)?))
    }

    fn ending(&self, task: &str) -> Option<String> {
        let shown = self.call("scontrol", &strings(["show", "job", "--oneliner", task])).ok();
        let state = shown.filter(|said| said.is_success).and_then(|said| parse_ending(&said.stdout));
        state.or_else(|| {
            // Where the controller has forgotten, a site's accounting may remember.
            let said = self.call("sacct", &strings(["-nXP", "-j", task, "-o", "State"])).ok()?;
            let word = said.stdout.split_whitespace().next()?;
            said.is_success.then(|| word.to_owned())
        })
    }

    fn cancel(&self, jobs: &[Job], say: Say) {
        let mut seen = HashSet::new();
        let ids: Vec<String> =
            jobs.iter().map(|job| job.id.clone()).filter(|id| seen.insert(id.clone())).collect();
        if let Ok(said) = self.call("scancel", &ids) {
            tell(&said.stderr, say);
        }
    }

    fn held_up(&self, jobs: &[Job]) -> Vec<String> {
        let mut lines = Vec::new();
        let mut seen = HashSet::new();
        for job in jobs.iter().filter(|job| job.is_held() && seen.insert(job.id.clone())) {
            lines.push(if job.reason.eq_ignore_ascii_case("DependencyNeverSatisfied") {
                format!("job {} can never start ({}); take it out: scancel {}", job.id, job.reason, job.id)
            } else if job.reason == "JobHeldAdmin" {
                format!(
                    "job {} is held by the site ({}); ask its administrators to type: scontrol release {}",
                    job.id, job.reason, job.id
                )
            } else {
                format!("job {} is held ({}); to release it: scontrol release {}", job.id, job.reason, job.id)
            });
        }
        let is_waiting = |job: &&Job| job.state == "pending" && job.reason != "Dependency" && !job.is_held();
        let Some(job) = jobs.iter().find(is_waiting) else { return lines };
        let partition = self.options.iter().find_map(|option| option.strip_prefix("--partition="));
        let (away, is_any_there) = self.nodes(partition);
        let reason = job.reason.to_lowercase();
        if is_any_there && !["down", "drain", "notavail"].iter().any(|word| reason.contains(word)) {
            return lines;
        }
        for [name, state, why] in away.iter().take(NODES) {
            lines.push(format!(
                "job {} waits ({}); node {name} is {state} ({why}); its administrators resume it: \
                 scontrol update nodename={name} state=resume",
                job.id, job.reason
            ));
        }
        lines
    }
}

fn strings<const N: usize>(words: [&str; N]) -> Vec<String> {
    words.map(str::to_owned).to_vec()
}

/// What a scheduler's program has said goes to the user as it is.
pub(crate) fn tell(text: &str, say: Say) {
    text.lines().filter(|line| !line.trim().is_empty()).for_each(say);
}

/// FNV-1a: the same for the same folder, on every machine and in every version.
fn fingerprint(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The arguments of sbatch.
fn arguments(request: &Request, options: &[String]) -> Vec<String> {
    let mut arguments = vec!["--parsable".to_owned(), format!("--job-name={}", request.name)];
    if let Some(tasks) = request.tasks {
        let limit = tasks.at_once.map(|limit| format!("%{limit}")).unwrap_or_default();
        arguments.push(format!("--array=0-{}{limit}", tasks.count.saturating_sub(1)));
    }
    if !request.after.is_empty() {
        arguments.push(format!("--dependency=afterany:{}", request.after.join(":")));
    }
    arguments.extend_from_slice(options);
    arguments.push(format!("--chdir={}", request.folder.display()));
    let (mode, file) = match request.log {
        Log::Tasks { file, .. } => ("append", file),
        Log::File(file) => ("truncate", file),
    };
    // A per cent sign would stand for the job's number.
    arguments.push(format!("--output={}", file.display().to_string().replace('%', "%%")));
    arguments.push(format!("--open-mode={mode}"));
    arguments.push(request.script.display().to_string());
    arguments
}

/// Whether sbatch failed by something that passes.
fn is_passing(text: &str) -> bool {
    let text = text.to_lowercase();
    ["contact", "connect", "timed out", "temporarily", "zero bytes"].iter().any(|word| text.contains(word))
}

/// The id in what `sbatch --parsable` says (`ID` or `ID;CLUSTER`), and the lines beside it.
fn parse_submission(text: &str) -> (Option<String>, String) {
    let mut id = None;
    let mut others = String::new();
    for line in text.lines() {
        let number = line.split(';').next().unwrap_or_default();
        if id.is_none() && !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) {
            id = Some(number.to_owned());
        } else {
            others.push_str(line);
            others.push('\n');
        }
    }
    (id, others)
}

/// Lines `%F|%i|%j|%T|%r` of squeue.
fn parse_queue(text: &str) -> Vec<Job> {
    let mut jobs = Vec::new();
    for line in text.lines() {
        let fields: Vec<&str> = line.splitn(5, '|').map(str::trim).collect();
        let [id, task, name, state, reason] = fields[..] else { continue };
        jobs.push(Job {
            id: id.to_owned(),
            task: task.to_owned(),
            name: name.to_owned(),
            state: state.to_lowercase(),
            reason: if reason == "None" { String::new() } else { reason.to_owned() },
        });
    }
    jobs
}

/// `MaxArraySize` in `scontrol show config`: indices run from 0 to one below it.
fn parse_array_size(text: &str) -> Option<usize> {
    text.lines()
        .filter_map(|line| line.split_once('='))
        .find(|(key, _)| key.trim() == "MaxArraySize")
        .and_then(|(_, value)| value.trim().parse().ok())
        .filter(|size| *size > 0)
}

/// `JobState` in `scontrol show job --oneliner`.
fn parse_ending(text: &str) -> Option<String> {
    let state = text.split_whitespace().find_map(|word| word.strip_prefix("JobState="))?;
    Some(state.to_owned())
}

/// Lines `%N|%T|%E` of sinfo: the nodes that take no jobs, and whether there are others.
fn parse_nodes(text: &str) -> (Vec<[String; 3]>, bool) {
    let mut away: Vec<[String; 3]> = Vec::new();
    let mut is_any_there = false;
    for line in text.lines() {
        let mut fields = line.splitn(3, '|').map(|field| field.trim().to_owned());
        let (Some(name), Some(state), Some(why)) = (fields.next(), fields.next(), fields.next()) else {
            continue;
        };
        let is_away = ["drain", "down", "fail", "maint", "unknown"].iter().any(|word| state.contains(word));
        if !is_away {
            is_any_there = true;
        } else if away.iter().all(|other| other[0] != name) {
            away.push([name, state, why]);
        }
    }
    (away, is_any_there)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::command::recorded::Answer::{Fails, Hangs, Missing, Says};
    use crate::command::recorded::{Answer, Recorded};
    use crate::scheduler::Tasks;

    fn slurm(answers: impl IntoIterator<Item = Answer>) -> (Slurm<Recorded>, Recorded) {
        let recorded = Recorded::new(answers);
        let cluster = Cluster {
            partition: Some("long".to_owned()),
            time: Some("60".to_owned()),
            threads: 2,
            ..Cluster::default()
        };
        (Slurm::with(recorded.clone(), &cluster, Patience::medium()), recorded)
    }

    fn request<'a>(after: &'a [String]) -> Request<'a> {
        Request {
            name: "gl-1-2-0",
            script: Path::new("/out/runs/.run/task.sh"),
            tasks: Some(Tasks { count: 10, at_once: Some(2) }),
            after,
            folder: Path::new("/out/runs"),
            log: Log::Tasks { file: Path::new("/out/50%/slurm.log"), folder: Path::new("/out/runs/.run") },
        }
    }

    #[test]
    fn an_array_is_submitted_with_what_the_site_wants() {
        let (slurm, recorded) = slurm([Says("17\n")]);
        assert_eq!(slurm.submit(&request(&["15".to_owned(), "16".to_owned()]), &|_| ()).unwrap(), "17");
        assert_eq!(
            recorded.calls.borrow()[0],
            "sbatch --parsable --job-name=gl-1-2-0 --array=0-9%2 --dependency=afterany:15:16 --cpus-per-task=2 \
             --partition=long --time=60 --chdir=/out/runs --output=/out/50%%/slurm.log --open-mode=append \
             /out/runs/.run/task.sh"
        );
    }

    #[test]
    fn the_id_stands_beside_warnings_and_the_name_of_a_cluster() {
        let said = "sbatch: Job charged to default account\n4711;north\n";
        assert_eq!(
            parse_submission(said),
            (Some("4711".to_owned()), "sbatch: Job charged to default account\n".to_owned())
        );
        assert_eq!(parse_submission("error 1\n").0, None);
    }

    #[test]
    fn a_job_that_was_taken_although_the_answer_was_lost_is_not_submitted_again() {
        let (slurm, recorded) = slurm([
            Fails(
                "sbatch: error: Batch job submission failed: Unable to contact slurm controller (connect failure)",
            ),
            Says("23|23_[0-9%2]|gl-1-2-0|PENDING|Resources\n"),
        ]);
        assert_eq!(slurm.submit(&request(&[]), &|_| ()).unwrap(), "23");
        assert_eq!(*recorded.pauses.borrow(), [1]);
    }

    #[test]
    fn a_job_that_was_lost_with_the_answer_is_submitted_again() {
        let (slurm, recorded) = slurm([Hangs, Says(""), Says("24\n")]);
        assert_eq!(slurm.submit(&request(&[]), &|_| ()).unwrap(), "24");
        assert_eq!(recorded.calls.borrow().len(), 3);
    }

    #[test]
    fn a_job_that_is_refused_is_not_tried_again() {
        let (slurm, _) = slurm([Fails("sbatch: error: invalid partition specified: long")]);
        let message = slurm.submit(&request(&[]), &|_| ()).unwrap_err().to_string();
        assert_eq!(message, "sbatch refused: sbatch: error: invalid partition specified: long");
    }

    #[test]
    fn a_controller_that_does_not_answer_is_asked_again_and_no_answer_is_no_empty_queue() {
        let noted = [Noted { name: "gl-1-2-0".to_owned(), id: None }];
        let (asked, recorded) = slurm([
            Fails("slurm_load_jobs error: Unable to contact slurm controller (connect failure)"),
            Says(""),
        ]);
        assert!(asked.queued(&noted).unwrap().is_empty());
        assert_eq!(recorded.calls.borrow()[1], "squeue --noheader --format=%F|%i|%j|%T|%r --name=gl-1-2-0");
        let (silent, recorded) =
            slurm([Hangs, Hangs, Hangs, Fails("Unable to contact slurm controller\nmore")]);
        let error = silent.queued(&noted).unwrap_err();
        assert!(error.is::<NoAnswer>());
        assert_eq!(error.to_string(), "the scheduler does not answer: Unable to contact slurm controller");
        assert_eq!(*recorded.pauses.borrow(), [1, 2, 4]);
    }

    #[test]
    fn nothing_is_asked_for_no_names() {
        assert!(slurm([]).0.queued(&[]).unwrap().is_empty());
    }

    #[test]
    fn the_queue_has_pending_tasks_of_an_array_in_one_line() {
        // Recorded: squeue of SLURM 22.05.
        let jobs = parse_queue(
            "3|3_[4-9%2]|gl-1-2-0|PENDING|JobArrayTaskLimit\n3|3_2|gl-1-2-0|RUNNING|None\n\
             4|4|gl-control-1|PENDING|Dependency\n5|5_1|gl-1-2-1|COMPLETING|None\n",
        );
        assert_eq!(jobs.len(), 4);
        assert_eq!((jobs[0].id.as_str(), jobs[0].task.as_str()), ("3", "3_[4-9%2]"));
        assert_eq!((jobs[1].state.as_str(), jobs[1].reason.as_str()), ("running", ""));
        assert_eq!(jobs[2].to_string(), "4: pending (Dependency)");
        assert!(jobs[3].is_ending());
    }

    #[test]
    fn the_largest_array_is_the_sites_or_slurms_default() {
        let config = "MaxArraySize            = 10001\nMaxBatchRequeue         = 5\n";
        assert_eq!(slurm([Says(config)]).0.largest_array(), Some(10001));
        assert_eq!(slurm([Hangs]).0.largest_array(), Some(1001));
    }

    #[test]
    fn a_task_that_was_killed_has_the_schedulers_reason() {
        let shown =
            "JobId=5 ArrayJobId=3 ArrayTaskId=2 JobName=gl JobState=OUT_OF_MEMORY Reason=OutOfMemory\n";
        assert_eq!(slurm([Says(shown)]).0.ending("3_2").as_deref(), Some("OUT_OF_MEMORY"));
        let forgotten = || Fails("slurm_load_jobs error: Invalid job id specified");
        assert_eq!(
            slurm([forgotten(), Says("CANCELLED by 0\n")]).0.ending("3_2").as_deref(),
            Some("CANCELLED")
        );
        assert_eq!(slurm([forgotten(), Missing]).0.ending("3_2"), None);
    }

    #[test]
    fn held_jobs_are_said_with_what_releases_them() {
        let held = parse_queue(
            "7|7_[0-9]|gl|PENDING|launch failed requeued held\n8|8|gl-control|PENDING|JobHeldAdmin\n\
             9|9|gl-control|PENDING|DependencyNeverSatisfied\n",
        );
        let lines = slurm([]).0.held_up(&held);
        assert_eq!(
            lines[0],
            "job 7 is held (launch failed requeued held); to release it: scontrol release 7"
        );
        assert!(lines[1].contains("ask its administrators to type: scontrol release 8"));
        assert!(lines[2].contains("can never start (DependencyNeverSatisfied); take it out: scancel 9"));
    }

    #[test]
    fn drained_nodes_are_said_where_a_job_waits_for_them() {
        let waiting = "7|7_[0-9]|gl|PENDING|Nodes required for job are DOWN, DRAINED or reserved\n";
        let nodes = "n1|drained|Duplicate jobid\nn2|idle|none\n";
        let (asked, recorded) = slurm([Says(nodes)]);
        assert_eq!(
            asked.held_up(&parse_queue(waiting)),
            ["job 7 waits (Nodes required for job are DOWN, DRAINED or reserved); node n1 is drained \
              (Duplicate jobid); its administrators resume it: scontrol update nodename=n1 state=resume"]
        );
        assert_eq!(recorded.calls.borrow()[0], "sinfo --noheader --Node --format=%N|%T|%E --partition=long");
        // Any cluster has some node that is drained.
        let queued = parse_queue("7|7_[0-9]|gl|PENDING|Priority\n");
        assert!(slurm([Says(nodes)]).0.held_up(&queued).is_empty());
        let all_away = "n1|drained*|Duplicate jobid\n";
        assert_eq!(slurm([Says(all_away)]).0.held_up(&queued).len(), 1);
    }

    #[test]
    fn a_folder_has_its_controlling_job_by_whatever_path() {
        let folder = tempfile::tempdir().unwrap();
        let slurm = slurm([]).0;
        assert_eq!(slurm.control_name(folder.path()), slurm.control_name(&folder.path().join(".")));
        assert_ne!(slurm.control_name(folder.path()), slurm.control_name(Path::new("/")));
        // Oracle: FNV-1a of "foobar" by its authors' test vectors.
        assert_eq!(fingerprint(b"foobar"), 0x8594_4171_f739_67e8);
    }
}
