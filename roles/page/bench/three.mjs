// Draws a whole model with three.js along a walk, as fast as the browser goes, and prints the pictures a
// second: what `trimaran view X.scene --drive PATH.json` is held against.
//   npm install --no-save three
//   node bench/three.mjs MODEL.glb PATH.json [SIDE]
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { build } from "esbuild";
import { chromium } from "playwright-core";

const [model, path, side = "1024"] = process.argv.slice(2);

/** Runs in the page. */
const SOURCE = `
import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

window.walk = async (side) => {
  const renderer = new THREE.WebGLRenderer({ antialias: false });
  renderer.setPixelRatio(1);
  renderer.setSize(side, side);
  document.body.style.margin = "0";
  document.body.append(renderer.domElement);
  const { vfov_deg, near = 0.05, frames } = await (await fetch("/path")).json();
  const { scene: model } = await new GLTFLoader().loadAsync("/model");
  // Materials that are as plain as ours, one for each colour.
  const materials = new Map();
  model.traverse((part) => {
    if (part.isMesh) {
      const colour = part.material.color?.getHex() ?? 0xffffff;
      if (!materials.has(colour)) {
        const { side } = part.material;
        materials.set(colour, new THREE.MeshLambertMaterial({ color: colour, side }));
      }
      part.material = materials.get(colour);
    }
  });
  model.updateMatrixWorld(true);
  model.matrixWorldAutoUpdate = false;
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xccddee);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x888888, 2), new THREE.DirectionalLight(0xffffff, 1), model);
  const camera = new THREE.PerspectiveCamera(vfov_deg, 1, near, 5000);
  const draw = (frame) => {
    const { eye, forward, up } = frames[frame];
    camera.position.set(...eye);
    camera.up.set(...up);
    camera.lookAt(...eye.map((at, axis) => at + forward[axis]));
    renderer.render(scene, camera);
  };
  // Loading on the way to the first picture is not part of the walk.
  draw(0);
  renderer.getContext().readPixels(0, 0, 1, 1, 6408, 5121, new Uint8Array(4));
  const begun = performance.now();
  for (let pictures = 0; ; pictures += 1) {
    await new Promise(requestAnimationFrame);
    const seconds = (performance.now() - begun) / 1000;
    const frame = Math.floor(30 * seconds);
    if (frame >= frames.length) {
      return { pictures, seconds, aSecond: pictures / seconds };
    }
    draw(frame);
  }
};
`;

const { outputFiles } = await build({
  stdin: { contents: SOURCE, resolveDir: process.cwd() },
  bundle: true,
  format: "esm",
  write: false,
});
const answers = {
  "/": ["text/html", '<!doctype html><body><script type="module" src="/main.js"></script>'],
  "/main.js": ["text/javascript", outputFiles[0].contents],
  "/path": ["application/json", readFileSync(path)],
  "/model": ["model/gltf-binary", readFileSync(model)],
};
const server = createServer(({ url }, answer) => {
  const [kind, body] = answers[url] ?? ["text/plain", ""];
  answer.writeHead(url in answers ? 200 : 404, { "content-type": kind }).end(body);
}).listen(0, "127.0.0.1");

const browser = await chromium.launch({
  executablePath: process.env.TRIMARAN_CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
const page = await browser.newPage({ viewport: { width: Number(side), height: Number(side) } });
await page.goto(`http://127.0.0.1:${server.address().port}/`);
console.log(JSON.stringify(await page.evaluate((side) => window.walk(side), Number(side))));
await browser.close();
server.close();
