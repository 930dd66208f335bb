// Serves the page from its sources in front of a running service, for whoever changes the page:
//   trimaran serve X.scene --listen 127.0.0.1:8080 --token TOKEN
//   npm run dev -- 127.0.0.1:8080 8081
// and http://127.0.0.1:8081/?token=TOKEN shows the page as it is now, bundled anew at each visit.
import { readFileSync } from "node:fs";
import { createServer, request } from "node:http";
import { connect } from "node:net";
import { extname } from "node:path";
import { build } from "esbuild";
import { PAGE } from "./build.mjs";

const [service = "127.0.0.1:8080", port = "8081"] = process.argv.slice(2);
const [host, servicePort] = service.split(":");
const KINDS = { ".js": "text/javascript", ".css": "text/css" };

const server = createServer(async (asked, answer) => {
  const path = asked.url?.split("?")[0] ?? "/";
  const ending = extname(path);
  if (ending in KINDS) {
    const { outputFiles } = await build({ ...PAGE, sourcemap: "inline", write: false });
    const file = outputFiles.find((file) => file.path.endsWith(path));
    answer.writeHead(file ? 200 : 404, { "content-type": KINDS[ending] }).end(file?.contents);
  } else if (path === "/") {
    answer.writeHead(200, { "content-type": "text/html" }).end(readFileSync("static/index.html"));
  } else {
    const { url: there, method } = asked;
    const passed = request({ host, port: servicePort, path: there, method }, (response) => {
      answer.writeHead(response.statusCode, response.headers);
      response.pipe(answer);
    });
    passed.on("error", () => answer.writeHead(502).end("the service does not answer\n"));
    asked.pipe(passed);
  }
});
server.on("upgrade", (asked, socket, head) => {
  const there = connect(Number(servicePort), host, () => {
    const lines = [`GET ${asked.url} HTTP/1.1`];
    for (const [name, value] of Object.entries(asked.headers)) {
      const own = name === "host" ? service : name === "origin" ? `http://${service}` : value;
      lines.push(`${name}: ${own}`);
    }
    there.write(`${lines.join("\r\n")}\r\n\r\n`);
    there.write(head);
    there.pipe(socket).pipe(there);
  });
  there.on("error", () => socket.destroy());
  socket.on("error", () => there.destroy());
});
server.listen(Number(port), "127.0.0.1");
