// Compiles a Kaitai Struct file: node compile.js IN.ksy FOLDER LANGUAGE. Needs the packages kaitai-struct-compiler, yaml.
const fs = require('fs');
const path = require('path');
const module_ = require('kaitai-struct-compiler');
const YAML = require('yaml');

const [, , input, folder, language] = process.argv;
const compiler = module_.compile ? module_ : (module_.default || module_);
const importer = { importYaml: (name) => Promise.reject(new Error(`${name}: nothing is imported`)) };
Promise.resolve(compiler.compile(language, YAML.parse(fs.readFileSync(input, 'utf8')), importer, false))
  .then((files) => {
    for (const [name, text] of Object.entries(files)) fs.writeFileSync(path.join(folder, name), text);
  })
  .catch((error) => {
    console.error(`${input}: ${error.message || error}`);
    process.exitCode = 1;
  });
