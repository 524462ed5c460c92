// Reads a CZML file by CesiumJS, and prints as JSON what it has at some times: positions in m along axes that
// are fixed to the Earth, and the attitude's quaternion, scalar last. Arguments: the folder in which `cesium`
// is installed, the file, and seconds from the start of its clock as a JSON list, in a file.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { join } from "node:path";

// CesiumJS asks of values whether they are pictures; node has no such classes.
for (const name of ["Image", "HTMLImageElement", "HTMLCanvasElement", "HTMLVideoElement", "ImageBitmap"]) {
  globalThis[name] ??= class {};
}

const [folder, file, instants] = process.argv.slice(2);
const C = createRequire(join(folder, "package.json"))("cesium");
const source = await C.CzmlDataSource.load(JSON.parse(readFileSync(file, "utf8")));
const times = JSON.parse(readFileSync(instants, "utf8"));
const craft = source.entities.getById("spacecraft");
const numbers = (value, keys) => (value === undefined ? null : keys.map((key) => value[key]));
const at = (seconds) => C.JulianDate.addSeconds(source.clock.startTime, seconds, new C.JulianDate());
const ends = source.entities.values.filter((entity) => entity.id.endsWith("/boresight-end"));
const place = (entity, time) => numbers(entity.position.getValue(time), ["x", "y", "z"]);
const rows = times.map((seconds) => {
  const time = at(seconds);
  return {
    attitude: numbers(craft.orientation.getValue(time), ["x", "y", "z", "w"]),
    position: place(craft, time),
    ends: ends.map((entity) => place(entity, time)),
  };
});
const lines = source.entities.values.filter((entity) => entity.polyline !== undefined);
console.log(
  JSON.stringify({
    rows,
    span: C.JulianDate.secondsDifference(source.clock.stopTime, source.clock.startTime),
    lines: lines.map((entity) => ({
      name: entity.name,
      colour: entity.polyline.material.color.getValue(at(0)).toCssHexString(),
      points: entity.polyline.positions.getValue(at(times[0])).length,
    })),
  }),
);
