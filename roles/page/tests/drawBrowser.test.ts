/** Draws in a real browser, and checks the drawable at each pixel. */

import assert from "node:assert/strict";
import type { Section } from "../src/proto/viewState.ts";
import { drawing } from "./drawBrowser.ts";
import { folded } from "./drawScene.ts";

const drawn = drawing();

/** With all extensions of the browser, and without. */
for (const extensions of [true, false]) {
  const how = extensions ? "" : ", without extensions";

  drawn(
    `the nearest drawable shows, in whatever order they come${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(32, 32, { extensions });
      stage.set(plate(2, 2), plate(9, 9), plate(9, 9));
      const camera = cameraAt([0, 0, 0]);
      const [near, far, behind] = [
        drawableAt(0, [0, 0, -4]),
        drawableAt(1, [0, 0, -5]),
        drawableAt(2, [0, 0, 5]),
      ];
      const one = stage.items(camera, [near, far, behind]);
      const other = stage.items(camera, [behind, far, near]);
      stage.end();
      return [one, other];
    },
    ([one, other]) => {
      assert.deepEqual(one, other);
      // Two metres of four are half of the picture's width.
      const row = one?.[16]?.join(" ");
      assert.equal(row, [...Array(8).fill(1), ...Array(16).fill(0), ...Array(8).fill(1)].join(" "));
      assert.equal(one?.[3]?.join(" "), Array(32).fill(1).join(" "));
    },
  );

  drawn(
    `of surfaces in one place that shows whose box is nearer, whatever page and sides it is of${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(16, 16, { extensions });
      // The second piece fills a page, so that the third is in another one.
      const { vertices, indices } = plate(9, 9);
      const large = new Uint8Array(20 * 65_000);
      large.set(vertices);
      const small = { vertices, indices };
      stage.set(small, { vertices: large, indices }, { vertices: large, indices });
      const found: number[][] = [];
      for (const nearest of [0, 1, 2]) {
        for (const sides of [window.draw.FRONT_SIDE, window.draw.BOTH_SIDES]) {
          const drawables = [0, 1, 2].map((geometry) => {
            const box = [0, 0, geometry === nearest ? -4 : -6] as const;
            const facing = geometry === nearest ? sides : window.draw.BOTH_SIDES - sides;
            return drawableAt(geometry, [0, 0, -5], { worldMin: box, worldMax: box, sides: facing });
          });
          found.push([nearest, ...stage.seen(cameraAt([0, 0, 0]), drawables)]);
        }
      }
      stage.end();
      return found;
    },
    (found) => {
      for (const [nearest, ...seen] of found) {
        assert.deepEqual(seen, [nearest]);
      }
    },
  );

  drawn(
    `back faces are hidden only where the front alone shows, and in a mirror fronts stay fronts${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(16, 16, { extensions });
      stage.set(plate(9, 9));
      const turned = [-1, 0, 0, 0, 1, 0, 0, 0, -1];
      const mirrored = [-1, 0, 0, 0, 1, 0, 0, 0, 1];
      const mirroredAndTurned = [1, 0, 0, 0, 1, 0, 0, 0, -1];
      const found = [undefined, turned, mirrored, mirroredAndTurned].map((linear) =>
        [window.draw.BOTH_SIDES, window.draw.FRONT_SIDE].map((sides) => {
          const more = { geometry: 0, sides, ...(linear === undefined ? {} : { linear }) };
          return stage.seen(cameraAt([0, 0, 0]), [drawableAt(7, [0, 0, -3], more)]).length;
        }),
      );
      stage.end();
      return found;
    },
    (found) => {
      // Both sides, and only the front.
      assert.deepEqual(found, [
        [1, 1],
        [1, 0],
        [1, 1],
        [1, 0],
      ]);
    },
  );

  drawn(
    `nothing changes where camera and model are 500 km away${how}`,
    extensions,
    (extensions) => {
      const { box, cameraAt, drawableAt, pipe, Stage } = window.draw;
      const stage = new Stage(96, 96, { extensions });
      stage.set(box([1, 2, 3], [255, 0, 0]), pipe(0.2, 6, 12, 2, [0, 200, 0]));
      const turn = [0.1, 0.2, 0.05, Math.sqrt(1 - 0.01 - 0.04 - 0.0025)] as const;
      const [items, pictures] = [[] as number[][], [] as number[][]];
      for (const by of [0, 500_000]) {
        const camera = { ...cameraAt([0.5 + by, 0.25 - by, 2 + by]), orientation: turn };
        const drawables = Array.from({ length: 40 }, (_, id) => {
          const [x, y, z] = [((id * 7) % 16) - 8, ((id * 5) % 11) - 5, -4 - ((id * 3) % 13)];
          return drawableAt(id, [x / 2 + by, y / 2 - by, z + by], {
            geometry: id % 2,
            sides: id & 1 ? window.draw.FRONT_SIDE : window.draw.BOTH_SIDES,
          });
        });
        items.push(stage.items(camera, drawables).flat());
        pictures.push([...stage.picture(camera, drawables)]);
      }
      stage.end();
      return { items, pictures };
    },
    ({ items, pictures }) => {
      assert.ok(new Set(items[0]).size > 10, "several are seen");
      assert.deepEqual(items[1], items[0]);
      assert.deepEqual(pictures[1], pictures[0]);
    },
  );

  drawn(
    `a point's pixel is where the projection says${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(80, 50, { extensions });
      // A plate smaller than a pixel, before the centres of pixels far apart.
      stage.set(plate(0.6, 0.6));
      const found: [number, number, number[]][] = [];
      for (const [x, y] of [
        [0, 0],
        [79, 0],
        [40, 25],
        [13, 41],
        [79, 49],
      ] as const) {
        // Half of the picture's height is 25 pixels; at the distance of 50 it is 25 metres.
        const origin = [x + 0.5 - 40, 25 - (y + 0.5), -50] as const;
        const rows = stage.items(cameraAt([0, 0, 0]), [drawableAt(3, origin, { geometry: 0 })]);
        const hits = rows.flatMap((row, at) => row.flatMap((id, column) => (id === 3 ? [column, at] : [])));
        found.push([x, y, hits]);
      }
      stage.end();
      return found;
    },
    (found) => {
      for (const [x, y, hits] of found) {
        assert.deepEqual(hits, [x, y]);
      }
    },
  );

  drawn(
    `a triangle has the colour of its first corner${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, MeshMaker, Stage } = window.draw;
      const stage = new Stage(16, 16, { extensions });
      const maker = new MeshMaker();
      const colours = [
        [200, 0, 0],
        [0, 200, 0],
        [0, 0, 200],
      ] as const;
      const corners = [
        [-9, -9, 0],
        [9, -9, 0],
        [0, 9, 0],
      ] as const;
      const vertices = corners.map((corner, at) =>
        maker.vertex(corner, [colours[at] ?? [0, 0, 0], [0, 0, 1]]),
      );
      maker.face(...vertices);
      // The same triangle, but it begins at another corner.
      const { vertices: bytes, indices } = maker.mesh();
      const turns = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
      ];
      stage.set(
        ...turns.map((turn) => ({ vertices: bytes, indices: indices.map((_, at) => turn[at] ?? 0) })),
      );
      const found = turns.map((_, id) =>
        // The winding is kept: all three show their fronts.
        stage.colour(
          cameraAt([0, 0, 0]),
          [drawableAt(id, [0, 0, -5], { sides: window.draw.FRONT_SIDE })],
          8,
          8,
        ),
      );
      stage.end();
      return found;
    },
    (found) => {
      for (const [at, colour] of found.entries()) {
        assert.equal(colour.indexOf(Math.max(...colour)), at, `${found}`);
        assert.ok(Math.max(...colour) > 100, `${found}`);
      }
    },
  );

  drawn(
    `at rest a pipe of twelve sides looks round, a box stays flat, and nothing else changes${how}`,
    extensions,
    (extensions) => {
      const { box, cameraAt, drawableAt, pipe, Stage, turned } = window.draw;
      const stage = new Stage(128, 128, { samples: 1, extensions });
      const { renderer, gl } = stage;
      const tank = turned(24, [
        [0.5, 0],
        [0.5, 0.5],
        [0, 0.6],
      ]);
      stage.set(pipe(1, 2, 12, 2, [200, 200, 200]), box([1, 1, 1]), tank);
      const camera = cameraAt([0, 0, 0]);
      /** The steps of the green tone between neighbours, within 24 pixels from the middle. */
      const steps = () => {
        const row = new Uint8Array(4 * 49);
        gl.readPixels(40, 64, 49, 1, gl.RGBA, gl.UNSIGNED_BYTE, row);
        const tones = [...row].filter((_, at) => at % 4 === 1);
        return tones.slice(1).map((tone, at) => Math.abs(tone - (tones[at] ?? 0)));
      };
      const mirrored = [-1, 0, 0, 0, 1, 0, 0, 0, 1];
      const looks = [
        drawableAt(0, [0, 0, -4]),
        drawableAt(0, [0, 0, -4], { linear: mirrored }),
        drawableAt(1, [0, 0, -1.9]),
      ].map((drawable) => {
        renderer.draw(camera, [drawable]);
        const flat = Math.max(...steps());
        while (renderer.refine()) {}
        return { flat, fine: Math.max(...steps()) };
      });
      // The rim of the tank is copied, which must not show.
      const shown = [drawableAt(2, [0, -0.3, -2])];
      const seen = () => [stage.items(camera, shown), renderer.triangles(2), stage.picture(camera, shown)];
      const before = JSON.stringify(seen());
      const { bytes } = renderer;
      renderer.draw(camera, shown);
      while (renderer.refine()) {}
      const isSame = JSON.stringify(seen()) === before;
      const copies = (renderer.bytes - bytes) / 24;
      for (const piece of [0, 1, 2]) {
        renderer.dropPiece(piece);
      }
      const left = renderer.bytes;
      stage.end();
      return { looks, isSame, copies, left };
    },
    ({ looks, isSame, copies, left }) => {
      const [round, mirrored, box] = looks;
      for (const { flat, fine } of [round, mirrored].filter((one) => one !== undefined)) {
        assert.ok(flat >= 15 && fine <= 6, `steps of ${flat}, and at rest of ${fine}`);
      }
      assert.ok(box !== undefined && box.flat === 0 && box.fine <= 2, JSON.stringify(box));
      assert.deepEqual([isSame, copies, left], [true, 24, 0]);
    },
  );

  drawn(
    `pieces that are gone draw nothing, and their room is used again${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, pipe, plate, Stage } = window.draw;
      const stage = new Stage(16, 16, { extensions });
      const { renderer } = stage;
      const [camera, shown] = [cameraAt([0, 0, 0]), drawableAt(5, [0, 0, -2], { geometry: 0 })];
      const seen = () => stage.seen(camera, [shown]).length;
      const nothing = [seen(), renderer.capacity];
      renderer.setPiece(0, plate(9, 9));
      const there = [seen(), renderer.triangles(0) !== undefined];
      renderer.dropPiece(0);
      const gone = [seen(), renderer.triangles(0) !== undefined, renderer.bytes];
      // Ten pieces at a time, out of a thousand, with the plate among them.
      const room = renderer.capacity;
      for (let piece = 1; piece <= 1000; piece += 1) {
        renderer.setPiece(piece, pipe(1, 1, 3 + (piece % 50), 1 + (piece % 7), [0, 0, 0]));
        renderer.dropPiece(piece - 10);
      }
      renderer.setPiece(0, plate(9, 9));
      const again = [seen(), renderer.capacity - room];
      // Another mesh under the same number replaces it.
      renderer.setPiece(0, plate(0.01, 0.01));
      const replaced = stage
        .items(camera, [shown])
        .flat()
        .filter((id) => id === 5).length;
      stage.end();
      return { nothing, there, gone, again, replaced };
    },
    ({ nothing, there, gone, again, replaced }) => {
      assert.deepEqual(nothing, [0, 0]);
      assert.deepEqual(there, [1, true]);
      assert.deepEqual(gone, [0, false, 0]);
      assert.deepEqual(again, [1, 0]);
      assert.ok(replaced < 4, `${replaced} pixels`);
    },
  );

  drawn(
    `many pages of geometry are drawn, and empty ones go${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(64, 64, { extensions });
      const { renderer } = stage;
      // Plates with so many unused vertices that the first page has room for two.
      const count = 12;
      for (let piece = 0; piece < count; piece += 1) {
        const { vertices, indices } = plate(0.2 + 0.05 * piece, 0.5);
        const large = new Uint8Array(20 * 30_000);
        large.set(vertices);
        renderer.setPiece(piece, { vertices: large, indices });
      }
      // Every other one is turned around, and shows its back.
      const turned = [-1, 0, 0, 0, 1, 0, 0, 0, -1];
      const drawables = Array.from({ length: count }, (_, id) => {
        const more = id % 2 === 1 ? { sides: window.draw.FRONT_SIDE } : { linear: turned };
        return drawableAt(id, [(id % 4) - 1.5, Math.floor(id / 4) - 1, -4], more);
      });
      const all = stage.seen(cameraAt([0, 0, 0]), drawables);
      const rows = stage.items(cameraAt([0, 0, 0]), drawables);
      const widths = all.map((id) => Math.max(...rows.map((row) => row.filter((one) => one === id).length)));
      const full = renderer.capacity;
      for (let piece = 0; piece < count; piece += 1) {
        if (piece !== 3 && piece !== 10) {
          renderer.dropPiece(piece);
        }
      }
      const rest = stage.seen(cameraAt([0, 0, 0]), drawables);
      const left = renderer.capacity;
      stage.end();
      return { all, widths, rest, full, left };
    },
    ({ all, widths, rest, full, left }) => {
      assert.equal(all.join(" "), "0 1 2 3 4 5 6 7 8 9 10 11");
      for (const [id, width] of widths.entries()) {
        // A metre is 16 pixels.
        assert.ok(Math.abs(width - 16 * (0.2 + 0.05 * id)) <= 1, `drawable ${id} is ${width} pixels wide`);
      }
      assert.deepEqual(rest, [3, 10]);
      assert.ok(full > 12 * 600_000 && left < full, `${full} bytes, then ${left}`);
    },
  );

  drawn(
    `a pixel says what it shows${how}`,
    extensions,
    (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(60, 40, { extensions });
      stage.set(plate(1, 1), plate(1, 1));
      const { renderer } = stage;
      const before = renderer.pick(30, 20);
      const [camera, drawables] = [
        cameraAt([0, 0, 0], 1),
        // One is in the upper left quarter, one in the lower right.
        [drawableAt(0, [-1, 1, -4]), drawableAt(1, [2, -1.5, -3])],
      ];
      renderer.draw(camera, drawables);
      const items = stage.items(camera, drawables);
      const differing: string[] = [];
      for (let y = 0; y < 40; y += 1) {
        for (let x = 0; x < 60; x += 1) {
          const picked = renderer.pick(x + 0.75, y + 0.25);
          if ((picked?.drawable ?? -1) !== items[y]?.[x]) {
            differing.push(`${x} ${y}`);
          }
        }
      }
      const [first, second] = [renderer.pick(25, 15), renderer.pick(43, 29)];
      const outside = [renderer.pick(-1, 0), renderer.pick(60, 0), renderer.pick(0, 40)];
      stage.end();
      return { isEarly: before !== undefined, differing, first, second, outside };
    },
    ({ isEarly, differing, first, second, outside }) => {
      assert.equal(isEarly, false);
      assert.deepEqual(differing, []);
      for (const [picked, drawable, depth] of [
        [first, 0, 4],
        [second, 1, 3],
      ] as const) {
        assert.deepEqual([picked?.drawable, picked?.object], [drawable, 1000 + drawable]);
        assert.ok(Math.abs((picked?.depth ?? 0) - depth) < 1e-4 * depth, `${picked?.depth} metres`);
      }
      assert.ok(outside.every((picked) => picked === undefined));
    },
  );

  drawn(
    `a lost context is restored${how}`,
    extensions,
    async (extensions) => {
      const { cameraAt, drawableAt, plate, Stage } = window.draw;
      const stage = new Stage(16, 16, { extensions });
      const { renderer, said, gl } = stage;
      const [camera, shown] = [cameraAt([0, 0, 0]), drawableAt(0, [0, 0, -2])];
      const waitFor = async (word: string) => {
        for (let i = 0; i < 500 && said.at(-1) !== word; i += 1) {
          await new Promise((resolve) => setTimeout(resolve, 10));
        }
      };
      stage.set(plate(9, 9));
      const before = [stage.seen(camera, [shown]).length, stage.colour(camera, [shown], 8, 8)];
      const loss = gl.getExtension("WEBGL_lose_context");
      loss?.loseContext();
      await waitFor("lost");
      // Pieces set meanwhile are neither drawn nor kept, and nothing breaks.
      stage.set(plate(9, 9));
      renderer.draw(camera, [shown]);
      const meanwhile = [stage.seen(camera, [shown]).length, renderer.isLost, renderer.bytes];
      const picked = renderer.pick(8, 8) !== undefined;
      loss?.restoreContext();
      await waitFor("restored");
      const empty = [stage.seen(camera, [shown]).length, renderer.triangles(0) !== undefined];
      stage.set(plate(9, 9));
      const again = [stage.seen(camera, [shown]).length, stage.colour(camera, [shown], 8, 8)];
      stage.end();
      return { before, meanwhile, picked, empty, again, said };
    },
    ({ before, meanwhile, picked, empty, again, said }) => {
      assert.equal(before[0], 1);
      assert.deepEqual([meanwhile, picked], [[0, true, 0], false]);
      assert.deepEqual(empty, [0, false]);
      assert.deepEqual(again, before);
      assert.deepEqual(said.slice(0, 2), ["lost", "restored"]);
    },
  );
}

drawn(
  "the picture shows the sky above the horizon and the ground below, wherever the camera looks",
  undefined,
  () => {
    const { cameraAt, Stage } = window.draw;
    const stage = new Stage(9, 101);
    const level = stage.picture(cameraAt([0, 0, 0]), []).slice();
    const half = Math.sin(0.1);
    const up = stage.picture({ ...cameraAt([0, 0, 0]), orientation: [half, 0, 0, Math.cos(0.1)] }, []);
    /** Blue less red, row by row from below: the sky is blue, and the ground is grey. */
    const blues = (picture: Uint8Array) =>
      Array.from({ length: 101 }, (_, row) => (picture[4 * 9 * row + 2] ?? 0) - (picture[4 * 9 * row] ?? 0));
    const found = [blues(level), blues(up)].map((rows) => rows.findIndex((blue) => blue > 6));
    stage.end();
    return found;
  },
  ([level = 0, up = 0]) => {
    assert.ok(Math.abs(level - 50) <= 3, `the horizon is in row ${level} of 101`);
    // 0.2 radians down, where 0.5 is the tangent of half the picture.
    assert.ok(Math.abs(up - (50 - (50 * Math.tan(0.2)) / 0.5)) <= 3, `the horizon is in row ${up} of 101`);
  },
);

/** Directions all around, with zeros and signs of all kinds. */
const NORMALS = [-2, -1, 0, 1, 2].flatMap((x) =>
  [-2, -1, 0, 1, 2].flatMap((y) => [-2, -1, 0, 1, 2].map((z) => [x, y, z] as [number, number, number])),
);

drawn(
  "the shaders unfold normals",
  NORMALS.filter((normal) => Math.hypot(...normal) > 0).map(folded),
  (normals) => Array.from(window.draw.unfolded(normals)),
  (found) => {
    const expected = NORMALS.filter((normal) => Math.hypot(...normal) > 0);
    for (const [at, normal] of expected.entries()) {
      const sum = normal.reduce((sum, coordinate) => sum + Math.abs(coordinate), 0);
      for (const [axis, coordinate] of normal.entries()) {
        const got = found[3 * at + axis] ?? 0;
        assert.ok(Math.abs(got - coordinate / sum) < 1e-4, `${normal}: ${found.slice(3 * at, 3 * at + 3)}`);
      }
    }
  },
);

drawn(
  "edges are smooth with four samples a pixel, and items are not",
  undefined,
  () => {
    const { cameraAt, drawableAt, plate, Stage } = window.draw;
    const slanted = [0.96, 0.28, 0, -0.28, 0.96, 0, 0, 0, 1];
    return [1, 4].map((samples) => {
      const stage = new Stage(64, 64, { samples });
      stage.set(plate(1, 1, [0, 0, 0]));
      const drawables = [drawableAt(0, [0, 0, -2], { linear: slanted })];
      const picture = stage.picture(cameraAt([0, 0, 0]), drawables);
      const tones = new Set(picture.filter((_, at) => at % 4 === 0));
      const seen = stage.seen(cameraAt([0, 0, 0]), drawables);
      const at = [stage.renderer.samples, tones.size, ...seen];
      stage.end();
      return at;
    });
  },
  ([one, four]) => {
    assert.equal(one?.[0], 1);
    assert.equal(four?.[0], 4);
    assert.ok((four?.[1] ?? 0) > (one?.[1] ?? 0) + 10, `${one?.[1]} tones, then ${four?.[1]}`);
    assert.deepEqual([one?.slice(2), four?.slice(2)], [[0], [0]]);
  },
);

drawn(
  "at rest a picture becomes smooth and has lines, and shows the same items",
  undefined,
  () => {
    const { cameraAt, drawableAt, plate, Stage } = window.draw;
    const slanted = [0.96, 0.28, 0, -0.28, 0.96, 0, 0, 0, 1];
    const stage = new Stage(64, 64, { samples: 1 });
    stage.set(plate(1, 1, [200, 200, 200]));
    const camera = cameraAt([0, 0, 0]);
    // One before the other, and two in one plane beside each other.
    const drawables = [drawableAt(0, [0, 0, -2], { linear: slanted }), drawableAt(1, [0.2, 0, -6])];
    const tonesOf = (pixels: Uint8Array) => new Set(pixels.filter((_, at) => at % 4 === 0)).size;
    const before = tonesOf(stage.picture(camera, drawables));
    const items = stage.items(camera, drawables).flat();
    stage.renderer.draw(camera, drawables);
    let steps = 1;
    for (; stage.renderer.refine(); steps += 1) {}
    const after = new Uint8Array(4 * 64 * 64);
    stage.gl.readPixels(0, 0, 64, 64, stage.gl.RGBA, stage.gl.UNSIGNED_BYTE, after);
    const isSame = stage
      .items(camera, drawables)
      .flat()
      .every((id, at) => id === items[at]);
    const darkest = Math.min(...after.filter((_, at) => at % 4 === 0));
    const isMore = stage.renderer.refine();
    stage.end();
    return { before, after: tonesOf(after), steps, isSame, darkest, isMore };
  },
  ({ before, after, steps, isSame, darkest, isMore }) => {
    assert.deepEqual([steps, isSame, isMore], [8, true, false]);
    assert.ok(after > before + 20, `${before} tones, then ${after}`);
    assert.ok(darkest < 110, `a line is ${darkest}`);
  },
);

drawn(
  "a step of a picture at rest waits until the device has drawn the one before",
  undefined,
  async () => {
    const { cameraAt, drawableAt, plate, Stage } = window.draw;
    const stage = new Stage(64, 64, { samples: 1 });
    stage.set(plate(1, 1));
    const [camera, drawables] = [cameraAt([0, 0, 0]), [drawableAt(0, [0, 0, -2])]];
    const refineAll = async () => {
      stage.renderer.draw(camera, drawables);
      while (stage.renderer.refine(true)) {
        await new Promise((resolve) => setTimeout(resolve, 5));
      }
    };
    // The code for normals is loaded with the first one.
    await refineAll();
    stage.renderer.draw(camera, drawables);
    stage.renderer.refine();
    const { gl } = stage;
    const wait = gl.clientWaitSync;
    gl.clientWaitSync = () => gl.TIMEOUT_EXPIRED;
    for (let ask = 0; ask < 20; ask += 1) {
      stage.renderer.refine(true);
    }
    const whileBusy = stage.renderer.isFine;
    gl.clientWaitSync = wait;
    await refineAll();
    const { isFine } = stage.renderer;
    stage.end();
    return { whileBusy, isFine };
  },
  ({ whileBusy, isFine }) => assert.deepEqual([whileBusy, isFine], [false, true]),
);

drawn(
  "a picture in tiles is that of an eye at rest: smooth, with lines and hatching",
  undefined,
  async () => {
    const { box, cameraAt, drawableAt, ObjectSet, pipe, plate, Stage, tileDifference } = window.draw;
    const pictures: Awaited<ReturnType<typeof tileDifference>>[] = [];
    for (const samples of [1, 4]) {
      const stage = new Stage(420, 400, { samples });
      stage.set(box([0.6, 0.6, 1], [60, 60, 255]), pipe(0.2, 2, 12, 2, [0, 200, 0]), plate(30, 5));
      const turn: [number, number, number, number] = [0.02, 0.01, 0, Math.sqrt(1 - 0.0005)];
      const camera = { ...cameraAt([0, 0, 0]), orientation: turn };
      // Things that stand at a wall, which is below the sky.
      const things = Array.from({ length: 49 }, (_, id) => {
        const [x, y] = [(id % 7) - 3, Math.floor(id / 7) * 0.8 - 3];
        const sides = id % 2 === 0 ? window.draw.FRONT_SIDE : window.draw.BOTH_SIDES;
        return drawableAt(id, [x, y, -6.2], { geometry: id % 2, sides });
      });
      const wall = drawableAt(49, [0, -1, -6.5], { geometry: 2 });
      const plane: Section = { kind: "plane", point: [0, 0, -5.9], direction: [0.3, 0, 1] };
      const look = {
        sections: [plane],
        seeThrough: ObjectSet.of([1003, 1004, 1017]),
        highlighted: ObjectSet.of([1006]),
      };
      pictures.push(await tileDifference(stage, camera, [...things, wall], look, 135));
      stage.end();
    }
    return pictures;
  },
  (found) => {
    for (const { tiles, differing, wrong, colours } of found) {
      assert.equal(tiles, 12);
      assert.ok(colours > 300, `${colours} colours`);
      // Rounding may put an edge on the other side of one of the eight samples.
      assert.ok(differing < 2e-3 && wrong < 1e-4, `${100 * differing} %, ${100 * wrong} %`);
    }
  },
);

drawn(
  "sections cut the same from the picture, the items and what is picked, and solids show their inside",
  undefined,
  () => {
    const { box, cameraAt, drawableAt, ObjectSet, Stage } = window.draw;
    const stage = new Stage(64, 64, { samples: 1 });
    stage.set(box([1, 1, 1], [0, 0, 255]));
    const camera = cameraAt([0, 0, 0]);
    const drawables = [
      drawableAt(7, [0, 0, -4], { geometry: 0, sides: window.draw.FRONT_SIDE }),
      drawableAt(8, [0, 0, -9], { geometry: 0, sides: window.draw.FRONT_SIDE }),
    ];
    const look = (sections: readonly Section[], through: readonly number[] = []) => {
      return { sections, seeThrough: ObjectSet.of(through), highlighted: ObjectSet.EMPTY };
    };
    const plane = (x: number, z: number): Section => {
      return { kind: "plane", point: [0, 0, -4], direction: [x, 0, z] };
    };
    const at = (sections: readonly Section[], through?: readonly number[]) => {
      const chosen = look(sections, through);
      stage.renderer.draw(camera, drawables, chosen);
      const colour = new Uint8Array(4);
      stage.gl.readPixels(32, 32, 1, 1, stage.gl.RGBA, stage.gl.UNSIGNED_BYTE, colour);
      const picked = stage.renderer.pick(32, 31);
      const item = stage.renderer.items(camera, drawables, chosen)[64 * 32 + 32];
      return { item, drawable: picked?.drawable, depth: picked?.depth, red: colour[0], blue: colour[2] };
    };
    const found = {
      whole: at([]),
      // Cuts away everything nearer than the middle of the first box.
      opened: at([plane(0, 1)]),
      gone: at([{ kind: "box", lower: [-5, -5, -20], upper: [5, 5, -6] }]),
      through: at([], [drawables[0]?.object ?? 0]),
    };
    stage.end();
    return found;
  },
  ({ whole, opened, gone, through }) => {
    assert.deepEqual([whole.item, whole.drawable, opened.item, opened.drawable], [7, 7, 7, 7]);
    assert.ok(Math.abs((whole.depth ?? 0) - 3.5) < 1e-3, `${whole.depth}`);
    assert.ok((opened.depth ?? 0) > (whole.depth ?? 0) + 0.5, `${opened.depth} behind ${whole.depth}`);
    assert.ok((opened.red ?? 0) > (opened.blue ?? 0), "its inside is painted");
    assert.ok((whole.blue ?? 0) > (whole.red ?? 0));
    assert.deepEqual([gone.item, gone.drawable], [8, 8]);
    // Clicks pass through see-through objects, and the one behind is visible.
    assert.deepEqual([through.item, through.drawable], [7, 8]);
  },
);

drawn(
  "a colour takes the place of the model's, and a highlight and culling stay",
  undefined,
  () => {
    const { box, cameraAt, drawableAt, ObjectColours, ObjectSet, Stage } = window.draw;
    const stage = new Stage(64, 64);
    stage.set(box([1, 1, 1], [255, 0, 0]));
    const camera = cameraAt([0, 0, 0]);
    const drawables = [-1, 1].map((x, object) =>
      drawableAt(40 + object, [x, 0, -4], { geometry: 0, object, sides: window.draw.FRONT_SIDE }),
    );
    const paints = [{ label: "", colour: 0x0000ff, objects: ObjectSet.of([1]) }];
    const draw = (by: string, picked: readonly number[]) => {
      const look = {
        sections: [],
        seeThrough: ObjectSet.EMPTY,
        highlighted: ObjectSet.of(picked),
        colours: by === "none" ? undefined : new ObjectColours({ by, paints }),
      };
      stage.renderer.draw(camera, drawables, look);
      return [20, 44].map((x) => {
        const colour = new Uint8Array(4);
        stage.gl.readPixels(x, 32, 1, 1, stage.gl.RGBA, stage.gl.UNSIGNED_BYTE, colour);
        return { colour: [...colour.slice(0, 3)], drawable: stage.renderer.pick(x, 31)?.drawable };
      });
    };
    const found = { plain: draw("none", []), hand: draw("", []), by: draw("Size", []), both: draw("", [1]) };
    stage.end();
    return found;
  },
  ({ plain, hand, by, both }) => {
    const colours = (pair: typeof plain) => pair.map(({ colour }) => colour);
    const [left = [], right = []] = colours(plain);
    assert.deepEqual(left, right, "both boxes are red");
    assert.ok((left[0] ?? 0) > 4 * (left[2] ?? 0));
    const [red, blue = []] = colours(hand);
    assert.deepEqual(red, left, "what has no colour stays");
    // Shading only makes it darker: its hue is that of the legend.
    assert.deepEqual([blue[0], blue[1]], [0, 0]);
    assert.ok((blue[2] ?? 0) > 100);
    const [grey = [], again] = colours(by);
    assert.deepEqual(again, blue);
    assert.ok(grey[0] === grey[1] && grey[1] === grey[2] && (grey[0] ?? 0) > 100, `${grey}`);
    const [, orange = []] = colours(both);
    assert.ok(
      (orange[0] ?? 0) > (orange[1] ?? 0) && (orange[1] ?? 0) > 50 && (orange[2] ?? 0) > 50,
      `${orange}`,
    );
    for (const pair of [plain, hand, by, both]) {
      assert.deepEqual(
        pair.map(({ drawable }) => drawable),
        [40, 41],
      );
    }
  },
);

drawn(
  "a picture tells surfaces apart that are two kilometres away, whatever it is drawn into",
  undefined,
  () => {
    const { box, cameraAt, drawableAt, Stage } = window.draw;
    return [1, 4].map((samples) => {
      const stage = new Stage(16, 16, { samples });
      stage.set(box([900, 900, 1], [255, 0, 0]), box([900, 900, 1], [0, 255, 0]));
      const drawables = [
        // Its box begins at the eye, so it is drawn first.
        drawableAt(1, [0, 0, -2002], { geometry: 0, worldMin: [0, 0, -2002], worldMax: [0, 0, 0] }),
        drawableAt(2, [0, 0, -2000], { geometry: 1 }),
      ];
      const camera = { ...cameraAt([0, 0, 0]), near: 0.05 };
      const [red = 0, green = 0] = stage.colour(camera, drawables, 8, 8);
      stage.end();
      return { depth: stage.renderer.depth, isNearer: green > red };
    });
  },
  (pictures) => {
    const [{ depth } = { depth: "standard" }] = pictures;
    assert.deepEqual(
      pictures.map(({ isNearer }) => isNearer || depth === "standard"),
      [true, true],
    );
  },
);

drawn(
  "a picture of boxes and pipes",
  undefined,
  () => {
    const { box, cameraAt, drawableAt, pipe, Stage } = window.draw;
    const stage = new Stage(64, 64, { extensions: true });
    stage.set(box([1, 1, 1], [255, 0, 0]), pipe(0.2, 3, 12, 2, [0, 255, 0]));
    const camera = cameraAt([0, 0, 0]);
    const drawables = [
      drawableAt(1, [-0.5, 0, -4], { geometry: 0, sides: window.draw.FRONT_SIDE }),
      drawableAt(2, [0.7, 0, -4], { geometry: 1, sides: window.draw.FRONT_SIDE }),
      drawableAt(3, [40, 0, -4], { geometry: 1, sides: window.draw.FRONT_SIDE }),
    ];
    const colours = [
      [26, 32],
      [42, 32],
      [60, 4],
    ].map(([x = 0, y = 0]) => stage.colour(camera, drawables, x, y));
    const { calls, drawables: shown, triangles } = stage.renderer.drawn;
    const { depth, drawNumber, device } = stage.renderer;
    stage.end();
    return { colours, took: { calls, shown, triangles }, depth, drawNumber, device };
  },
  ({ colours, took, depth, drawNumber, device }) => {
    console.log(`depth is ${depth}, draws are numbered by ${drawNumber}, drawn by ${device}`);
    const [red = [], green = [], sky = []] = colours;
    assert.ok((red[0] ?? 0) > 2 * (red[1] ?? 0), `${red}`);
    assert.ok((green[1] ?? 0) > 2 * (green[0] ?? 0), `${green}`);
    assert.ok((sky[2] ?? 0) > 200, `${sky}`);
    // One call for both, and none for drawables outside the picture: 12 triangles and 48 + 24.
    assert.deepEqual(took, { calls: 1, shown: 2, triangles: 84 });
  },
);
