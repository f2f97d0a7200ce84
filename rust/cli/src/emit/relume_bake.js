// A job type of Flamenco 3: put this file into the folder `scripts` beside Flamenco Manager.
// Blender plans the job, then any machine with the program `relume` traces its parts.

const JOB_TYPE = {
    label: "Relume Bake",
    settings: [
        { key: "frames", type: "string", required: true, eval: "str(C.scene.frame_current)",
          description: "Frames to bake, each into a folder of its own, such as 1-10,15" },
        { key: "parts", type: "int32", required: true, default: 8, propargs: { min: 1 },
          description: "Parts that the bake of each frame is cut into" },
        { key: "folder", type: "string", subtype: "dir_path", required: true,
          eval: "str(Path(abspath(bpy.data.filepath)).with_suffix('')) + '_farm'",
          description: "Folder of the job, which all machines see" },
        { key: "relume", type: "string", required: true, default: "relume", visible: "submission",
          description: "The program of Relume on the machines" },
        { key: "blendfile", type: "string", required: true, visible: "web", description: "File to bake" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const plan = author.Task("plan", "blender");
    plan.addCommand(author.Command("blender-render", {
        exe: "{blender}",
        exeArgs: "{blenderArgs}",
        argsBefore: [],
        blendfile: settings.blendfile,
        args: [
            "--command", "relume", "farm", "--out", settings.folder,
            "--frames", settings.frames, "--parts", String(settings.parts),
        ],
    }));
    job.addTask(plan);

    const collect = author.Task("collect", "misc");
    collect.addCommand(author.Command("exec", { exe: settings.relume, args: ["collect", settings.folder] }));
    const parts = frameChunker(settings.frames, 1).length * settings.parts;
    for (let number = 1; number <= parts; number++) {
        const part = author.Task("part-" + number, "blender");
        part.addCommand(author.Command("exec", {
            exe: settings.relume,
            args: ["work", settings.folder, "--part", String(number)],
        }));
        part.addDependency(plan);
        collect.addDependency(part);
        job.addTask(part);
    }
    job.addTask(collect);
}
