use serde_json::{Value, json};

/// A template of Open Job Description (revision 2023-09) for a job with so many parts; `chunked` if a machine is given
/// several at a time.
pub fn template(parts: usize, chunked: bool) -> String {
    let run = |arguments: &[&str]| {
        let stop = json!({ "mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 60 });
        let action = json!({ "command": "{{Param.Relume}}", "args": arguments, "cancelation": stop });
        json!({ "actions": { "onRun": action } })
    };
    let range = format!("1-{parts}");
    let part = match chunked {
        true => json!({
            "name": "Part", "type": "CHUNK[INT]", "range": range,
            "chunks": { "defaultTaskCount": "{{Param.PartsAtATime}}", "rangeConstraint": "NONCONTIGUOUS" },
        }),
        false => json!({ "name": "Part", "type": "INT", "range": range }),
    };
    let paths = json!({
        "name": "Paths",
        "parameterSpace": { "taskParameterDefinitions": [part] },
        "script": run(&["work", "{{Param.Job}}", "--part", "{{Task.Param.Part}}"]),
    });
    let collect = json!({
        "name": "Collect",
        "dependencies": [{ "dependsOn": "Paths" }],
        "script": run(&["collect", "{{Param.Job}}"]),
    });
    let mut template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": "Relume bake",
        "parameterDefinitions": parameters(chunked),
        "steps": [paths, collect],
    });
    if chunked {
        template["extensions"] = json!(["TASK_CHUNKING"]);
    }
    format!("{template:#}\n")
}

fn parameters(chunked: bool) -> Vec<Value> {
    let mut parameters = vec![
        json!({
            "name": "Job", "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "INOUT", "default": ".",
            "description": "Folder of the job, with its plan",
        }),
        json!({ "name": "Relume", "type": "STRING", "default": "relume", "description": "The program of Relume" }),
    ];
    if chunked {
        parameters.push(json!({
            "name": "PartsAtATime", "type": "INT", "default": 4, "minValue": 1,
            "description": "Parts that a machine is given at a time",
        }));
    }
    parameters
}
