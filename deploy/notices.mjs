// Prints the licences and copyright notices of the libraries in the program: crates, and the packages of its
// page. Each text is printed once.
//
//   cargo metadata --format-version 1 --filter-platform TRIPLE --features .. | node deploy/notices.mjs
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";

/** The files with notices in a folder, and in those of the libraries of C or C++ that it contains. */
function notices(folder, depth = 3) {
  const entries = readdirSync(folder, { withFileTypes: true }).sort((a, b) => (a.name < b.name ? -1 : 1));
  return entries.flatMap((entry) => {
    const path = join(folder, entry.name);
    if (entry.isDirectory()) {
      return depth > 0 && entry.name !== "node_modules" ? notices(path, depth - 1) : [];
    }
    return /^(licen[cs]e|copying|copyright|notice|unlicense)([-_.].*)?$/i.test(entry.name) ? [path] : [];
  });
}

/** The crates linked into the root of `cargo metadata`, without those of its workspace. */
function crates({ packages, resolve, workspace_members: own }) {
  const found = new Map(packages.map((crate) => [crate.id, crate]));
  const nodes = new Map(resolve.nodes.map((node) => [node.id, node]));
  const isMacro = (id) => found.get(id).targets.some(({ kind }) => kind.includes("proc-macro"));
  const linked = new Set([resolve.root]);
  for (const id of linked) {
    for (const { pkg, dep_kinds: kinds } of nodes.get(id).deps) {
      if (kinds.some(({ kind }) => kind === null) && !isMacro(pkg)) linked.add(pkg);
    }
  }
  return [...linked]
    .filter((id) => !own.includes(id))
    .map((id) => ({ ...found.get(id), folder: dirname(found.get(id).manifest_path) }));
}

/** The packages bundled into the page, without those of its workspace. */
function bundled(root) {
  const { packages } = JSON.parse(readFileSync(join(root, "package-lock.json"), "utf8"));
  const modules = "node_modules/";
  return Object.entries(packages)
    .filter(([place, { dev, link }]) => place.startsWith(modules) && !dev && !link)
    .map(([place, entry]) => ({ ...entry, name: place.slice(modules.length), folder: join(root, place) }));
}

const libraries = [...crates(JSON.parse(readFileSync(0, "utf8"))), ...bundled("roles/page")];
const titled = libraries.map((library) => ({ title: `${library.name} ${library.version}`, ...library }));
titled.sort((a, b) => (a.title < b.title ? -1 : 1));
const texts = new Map();
for (const { title, license, folder } of titled) {
  console.log(`${title}: ${license}`);
  for (const file of notices(folder)) {
    const text = readFileSync(file, "utf8").replaceAll("\r\n", "\n").trim();
    texts.set(text, [...(texts.get(text) ?? []), `${title}: ${relative(folder, file)}`]);
  }
}
console.log("Rust's standard library: MIT OR Apache-2.0");
for (const [text, places] of texts) {
  console.log(`\n${"=".repeat(78)}\n${places.join("\n")}\n${"-".repeat(78)}\n${text}`);
}
