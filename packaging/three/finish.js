// Puts the licence of three.js before its code, as the licence asks.
const fs = require("fs");
const licence = fs.readFileSync("node_modules/three/LICENSE", "utf8").replace("©", "(c)").trim();
const { version } = JSON.parse(fs.readFileSync("node_modules/three/package.json", "utf8"));
const code = fs.readFileSync("bundle.js", "utf8");
const target = "../../gossamer_fx/records/plot/three.min.js";
fs.writeFileSync(target, `/* three.js ${version}, the parts named in packaging/three/entry.js\n\n${licence}\n*/\n${code}`);
