// Job type of Flamenco 3: put this file into the folder `scripts` of the manager.
// Each shot is a task; a last task writes the table of all.

const JOB_TYPE = {
  label: "KF Mocap",
  description: "Track shots, one task each",
  settings: [
    {
      key: "shots",
      type: "string",
      required: true,
      description: "Shot files, separated by commas, as workers see them",
    },
    {
      key: "out",
      type: "string",
      subtype: "dir_path",
      required: true,
      description: "Folder for the results, as workers see it",
    },
    {
      key: "command",
      type: "string",
      default: "kfmocap",
      required: true,
      description: "The program; a variable of the manager, such as {kfmocap}, names it on every platform",
    },
    {
      key: "blender_files",
      type: "bool",
      default: false,
      description: "Write BVH, FBX and shot.blend too: needs Blender's module bpy on the workers",
    },
  ],
};

function compileJob(job) {
  const settings = job.settings;
  const files = settings.shots
    .split(",")
    .map((file) => file.trim())
    .filter((file) => file.length > 0);
  const without = settings.blender_files ? [] : ["--no-blender"];
  const summary = author.Task("summary", "misc");
  for (const file of files) {
    const task = author.Task(file.split(/[\\/]/).pop(), "misc");
    const args = ["batch", file, "--out", settings.out, "--jobs", "1"].concat(without);
    task.addCommand(author.Command("exec", { exe: settings.command, args: args }));
    summary.addDependency(task);
    job.addTask(task);
  }
  const args = ["batch", files[0], "--out", settings.out, "--summary"].concat(without);
  summary.addCommand(author.Command("exec", { exe: settings.command, args: args }));
  job.addTask(summary);
}
