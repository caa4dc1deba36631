// The Khronos glTF validator over the files named as arguments; prints one JSON object: file -> { issues, numErrors }.
const fs = require("fs");
const path = require("path");
const validator = require("gltf-validator");

async function main() {
  const reports = {};
  for (const file of process.argv.slice(2)) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
      uri: path.basename(file),
      maxIssues: 10000,
      externalResourceFunction: (uri) =>
        fs.promises.readFile(path.join(path.dirname(file), decodeURIComponent(uri))).then((b) => new Uint8Array(b)),
    });
    const errors = report.issues.messages.filter((m) => m.severity === 0);
    reports[file] = { errors: errors.map(({ code, message, pointer }) => ({ code, message, pointer })) };
  }
  console.log(JSON.stringify(reports));
}

main().catch((error) => {
  console.error(String(error));
  process.exit(1);
});
