//! PBS and Torque: `qsub`, `qstat`, `qdel`.
//!
//! Torque, which is told apart by its version, gets a job a task.

use std::cell::OnceCell;
use std::env;
use std::io;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use gl_case::Cluster;

use crate::Say;
use crate::command::{Caller, Programs, Said};
use crate::scheduler::{Job, Log, NoAnswer, Noted, Patience, Request, Scheduler};
use crate::slurm::tell;

/// Sites differ in how long an array may be; this is PBS's own default limit.
const ARRAY_SIZE: usize = 10000;

/// PBS or Torque with the options of a site.
pub struct Pbs<C = Programs> {
    caller: C,
    patience: Patience,
    cluster: Cluster,
    is_pbs: OnceCell<bool>,
}

impl Pbs {
    /// With what the site wants of a job.
    pub fn new(cluster: &Cluster, patience: Patience) -> Self {
        Self::with(Programs, cluster, patience)
    }
}

impl<C: Caller> Pbs<C> {
    fn with(caller: C, cluster: &Cluster, patience: Patience) -> Self {
        Self { caller, patience, cluster: cluster.clone(), is_pbs: OnceCell::new() }
    }

    fn call(&self, program: &str, arguments: &[String]) -> io::Result<Said> {
        self.caller.call(program, arguments, self.patience.limit)
    }

    /// PBS, unlike Torque, says so in its version.
    fn is_pbs(&self) -> bool {
        *self.is_pbs.get_or_init(|| {
            self.call("qsub", &["--version".to_owned()]).is_ok_and(|said| {
                format!("{}{}", said.stdout, said.stderr).to_lowercase().contains("pbs_version")
            })
        })
    }

    /// What the site wants, in the words of qsub. Only with -S is it our shell that reads a job script.
    fn options(&self) -> Vec<String> {
        let Cluster { partition, account, time, mem, threads, .. } = &self.cluster;
        let mut options = vec!["-S".to_owned(), "/bin/bash".to_owned(), "-j".to_owned(), "oe".to_owned()];
        let mut add = |flag: &str, value: String| options.extend([flag.to_owned(), value]);
        if let Some(queue) = partition {
            add("-q", queue.clone());
        }
        if let Some(account) = account {
            add("-A", account.clone());
        }
        if let Some(time) = time {
            // A number alone is one of minutes to SLURM, and of seconds to PBS.
            let time =
                time.parse::<u64>().map_or_else(|_| time.clone(), |minutes| (minutes * 60).to_string());
            add("-l", format!("walltime={time}"));
        }
        let memory =
            |separator: char| mem.as_ref().map(|mem| format!("{separator}mem={mem}")).unwrap_or_default();
        add(
            "-l",
            if self.is_pbs() {
                format!("select=1:ncpus={threads}{}", memory(':'))
            } else {
                format!("nodes=1:ppn={threads}{}", memory(','))
            },
        );
        options
    }

    /// The state of a job, if it is in the queue.
    fn state(&self, id: &str) -> Result<Option<String>> {
        let mut pauses = self.patience.pauses.iter();
        loop {
            let problem = match self.call("qstat", &[id.to_owned()]) {
                Ok(said) if said.is_success => return Ok(parse_state(&said.stdout)),
                Ok(said) if is_over(&format!("{}{}", said.stdout, said.stderr)) => return Ok(None),
                Ok(said) => said.stderr,
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    bail!(NoAnswer("qstat is not installed here".to_owned()));
                }
                Err(error) => error.to_string(),
            };
            let Some(&pause) = pauses.next() else {
                bail!(NoAnswer(problem.lines().next().unwrap_or_default().to_owned()));
            };
            self.caller.pause(Duration::from_secs(pause));
        }
    }
}

impl<C: Caller> Scheduler for Pbs<C> {
    fn engine(&self) -> &'static str {
        "pbs"
    }

    fn check(&self) -> Result<()> {
        let version = self.call("qsub", &["--version".to_owned()]);
        ensure!(
            !version.is_err_and(|error| error.kind() == io::ErrorKind::NotFound),
            "qsub is not installed; is this a login node of a PBS cluster?"
        );
        Ok(())
    }

    fn largest_array(&self) -> Option<usize> {
        self.is_pbs().then_some(ARRAY_SIZE)
    }

    fn follows_arrays(&self) -> bool {
        false
    }

    fn array_name(&self, first: usize) -> String {
        // Not longer than 15 characters.
        format!("gl-{first}")
    }

    fn control_name(&self, _: &Path) -> String {
        "gl-control".to_owned()
    }

    fn own_job(&self) -> Option<String> {
        env::var("PBS_JOBID").ok()
    }

    fn submit(&self, request: &Request, say: Say) -> Result<String> {
        let mut arguments = vec!["-N".to_owned(), request.name.to_owned(), "-o".to_owned()];
        arguments.push(match request.log {
            Log::Tasks { folder, .. } => format!("{}/", folder.display()),
            Log::File(file) => file.display().to_string(),
        });
        arguments.extend(self.options());
        // PBS has no array of one.
        if let Some(tasks) = request.tasks.filter(|tasks| tasks.count > 1) {
            let limit = tasks.at_once.map(|limit| format!("%{limit}")).unwrap_or_default();
            arguments.extend(["-J".to_owned(), format!("0-{}{limit}", tasks.count - 1)]);
        }
        if !request.after.is_empty() {
            arguments.extend(["-W".to_owned(), format!("depend=afterany:{}", request.after.join(":"))]);
        }
        arguments.push(request.script.display().to_string());
        let said = self.call("qsub", &arguments).context("qsub")?;
        ensure!(said.is_success, "qsub refused: {}", said.stderr.trim());
        tell(&said.stderr, say);
        let id = said.stdout.lines().map(str::trim).rfind(|line| !line.is_empty());
        id.map(str::to_owned).context("qsub gave no job id")
    }

    fn queued(&self, noted: &[Noted]) -> Result<Vec<Job>> {
        let mut jobs = Vec::new();
        for Noted { name, id } in noted {
            let Some(id) = id else { continue };
            if let Some(state) = self.state(id)? {
                jobs.push(Job {
                    id: id.clone(),
                    task: id.clone(),
                    name: name.clone(),
                    state,
                    reason: String::new(),
                });
            }
        }
        Ok(jobs)
    }

    fn ending(&self, _: &str) -> Option<String> {
        None
    }

    fn cancel(&self, jobs: &[Job], say: Say) {
        let ids: Vec<String> = jobs.iter().map(|job| job.id.clone()).collect();
        if let Ok(said) = self.call("qdel", &ids) {
            // A job may have ended before.
            if !is_over(&said.stderr) {
                tell(&said.stderr, say);
            }
        }
    }

    fn held_up(&self, jobs: &[Job]) -> Vec<String> {
        // A controlling job is held until the runs have ended.
        jobs.iter()
            .filter(|job| job.state == "held" && job.name != "gl-control")
            .map(|job| format!("job {} is held; to release it: qrls {}", job.id, job.id))
            .collect()
    }
}

/// Whether qstat or qdel say that they know a job no more.
fn is_over(text: &str) -> bool {
    let text = text.to_lowercase();
    text.contains("unknown job") || text.contains("has finished")
}

/// The state in the table of qstat; nothing for a job that is complete (C, F).
fn parse_state(text: &str) -> Option<String> {
    let letter = text
        .lines()
        .filter_map(|line| line.split_whitespace().nth(4))
        .find(|word| word.len() == 1 && word.bytes().all(|byte| byte.is_ascii_uppercase()))?;
    let word = match letter {
        "C" | "F" => return None,
        "B" => "begun",
        "E" => "exiting",
        "H" => "held",
        "Q" => "queued",
        "R" => "running",
        "S" => "suspended",
        "T" => "moving",
        "W" => "waiting",
        other => other,
    };
    Some(word.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::recorded::Answer::{Fails, Hangs, Says};
    use crate::command::recorded::{Answer, Recorded};
    use crate::scheduler::Tasks;

    const PBS: Answer = Says("pbs_version = 22.05.11\n");
    const TORQUE: Answer = Says("Version: 6.1.2\n");

    fn pbs(answers: impl IntoIterator<Item = Answer>) -> (Pbs<Recorded>, Recorded) {
        let recorded = Recorded::new(answers);
        let cluster = Cluster {
            partition: Some("long".to_owned()),
            time: Some("60".to_owned()),
            mem: Some("2gb".to_owned()),
            ..Cluster::default()
        };
        (Pbs::with(recorded.clone(), &cluster, Patience::medium()), recorded)
    }

    fn request<'a>(tasks: Option<Tasks>, after: &'a [String]) -> Request<'a> {
        Request {
            name: "gl-0",
            script: Path::new("/out/task.sh"),
            tasks,
            after,
            folder: Path::new("/out/runs"),
            log: Log::Tasks { file: Path::new("/out/runs/x.log"), folder: Path::new("/out/.run") },
        }
    }

    #[test]
    fn pbs_gets_an_array_and_minutes_as_seconds() {
        let (pbs, recorded) = pbs([PBS, Says("17[].server\n")]);
        let tasks = Some(Tasks { count: 10, at_once: Some(2) });
        assert_eq!(pbs.submit(&request(tasks, &["16.server".to_owned()]), &|_| ()).unwrap(), "17[].server");
        assert_eq!(
            recorded.calls.borrow()[1],
            "qsub -N gl-0 -o /out/.run/ -S /bin/bash -j oe -q long -l walltime=3600 \
             -l select=1:ncpus=1:mem=2gb -J 0-9%2 -W depend=afterany:16.server /out/task.sh"
        );
    }

    #[test]
    fn torque_gets_a_plain_job() {
        let (torque, recorded) = pbs([TORQUE, Says("17.server\n")]);
        assert_eq!(torque.largest_array(), None);
        torque.submit(&request(None, &[]), &|_| ()).unwrap();
        assert!(recorded.calls.borrow()[1].contains("-l nodes=1:ppn=1,mem=2gb /out/task.sh"));
    }

    #[test]
    fn an_array_of_one_is_a_job() {
        let (pbs, recorded) = pbs([PBS, Says("17.server\n")]);
        pbs.submit(&request(Some(Tasks { count: 1, at_once: Some(2) }), &[]), &|_| ()).unwrap();
        assert!(!recorded.calls.borrow()[1].contains("-J"));
    }

    #[test]
    fn jobs_that_have_ended_are_unknown_or_complete_and_any_other_failure_is_no_answer() {
        let noted = |id: &str| [Noted { name: "gl-0".to_owned(), id: Some(id.to_owned()) }];
        let table = |state| {
            let text = format!(
                "Job id   Name  User  Time Use S Queue\n-------- ----- ----- -------- - -----\n\
                 17.server gl user 00:00:01 {state} batch\n"
            );
            Says(Box::leak(text.into_boxed_str()))
        };
        assert_eq!(pbs([table('R')]).0.queued(&noted("17")).unwrap()[0].state, "running");
        assert!(pbs([table('C')]).0.queued(&noted("17")).unwrap().is_empty());
        assert!(pbs([Fails("qstat: Unknown Job Id 17.server")]).0.queued(&noted("17")).unwrap().is_empty());
        assert!(pbs([Fails("qstat: 17.server Job has finished")]).0.queued(&noted("17")).unwrap().is_empty());
        let (silent, recorded) =
            pbs([Hangs, Fails("pbs_connect"), Hangs, Fails("cannot connect to server\n")]);
        let error = silent.queued(&noted("17")).unwrap_err();
        assert!(error.is::<NoAnswer>());
        assert_eq!(*recorded.pauses.borrow(), [1, 2, 4]);
    }

    #[test]
    fn a_refusal_says_why() {
        let (pbs, _) = pbs([PBS, Fails("qsub: Unknown queue\n")]);
        assert_eq!(
            pbs.submit(&request(None, &[]), &|_| ()).unwrap_err().to_string(),
            "qsub refused: qsub: Unknown queue"
        );
    }

    #[test]
    fn only_runs_that_are_held_want_release() {
        let job = |name: &str| Job {
            id: "17".to_owned(),
            task: "17".to_owned(),
            name: name.to_owned(),
            state: "held".to_owned(),
            reason: String::new(),
        };
        let lines = pbs([]).0.held_up(&[job("gl-0"), job("gl-control")]);
        assert_eq!(lines, ["job 17 is held; to release it: qrls 17"]);
    }
}
