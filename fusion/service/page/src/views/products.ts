// Products of the release, the report, and tables, to be downloaded.
import { ApiProblem, getAll, getJson, pathOf } from "../api";
import { element, fill } from "../dom";
import { downloadLink, filePath } from "../download";
import { bytes, count } from "../format";
import { hrefOf, type View } from "../router";
import { table } from "../table";

interface Product {
  file: string;
  kind: string;
  maplet?: string;
  bytes: number;
  sha256: string;
}
interface Manifest {
  body: string;
  format: string;
  settings_digest: string;
  products: Product[];
}

const TITLES: Record<string, string> = { map: "MAP", sigma: "SIG", fits: "FITS", obj: "OBJ", ply: "PLY", geotiff: "GeoTIFF" };
const FORMS: [title: string, type: string, ending: string][] = [
  ["CSV", "text/csv", "csv"],
  ["Parquet", "application/vnd.apache.parquet", "parquet"],
  ["Arrow", "application/vnd.apache.arrow.stream", "arrows"],
];

export const products: View = {
  title: "Products",
  async open(root, { workspace }, signal) {
    const [manifest, tables] = await Promise.all([
      releaseOf(workspace, signal),
      getAll<string>(pathOf(workspace, "tables"), "tables", { signal }),
    ]);
    fill(
      root,
      element("h1", {}, "Products"),
      typeof manifest === "string" ? element("p", { class: "quiet" }, manifest) : release(manifest, workspace),
      element(
        "section",
        { "aria-labelledby": "tables" },
        element("h2", { id: "tables" }, "Tables"),
        table<string>(
          "Tables",
          [
            { title: "Table", by: (name) => name, cell: (name) => name },
            {
              title: "Download",
              cell: (name) =>
                element("span", { class: "links" }, ...FORMS.map(([title, type, ending]) => downloadLink(pathOf(workspace, "tables", name), `${workspace}-${name}.${ending}`, title, type))),
            },
          ],
          tables,
        ),
      ),
    );
  },
};

/** Return the manifest, or why there is none. */
async function releaseOf(workspace: string, signal: AbortSignal): Promise<Manifest | string> {
  try {
    return await getJson<Manifest>(pathOf(workspace, "products"), { signal });
  } catch (error) {
    if (error instanceof ApiProblem && [404, 409].includes(error.status)) return "Nothing is released yet: run the stage release.";
    throw error;
  }
}

function release(manifest: Manifest, workspace: string): HTMLElement {
  const kinds = [...new Set(manifest.products.filter((one) => one.maplet).map((one) => one.kind))];
  const sites = Map.groupBy(manifest.products.filter((one) => one.maplet), (one) => one.maplet!);
  const others = manifest.products.filter((one) => !one.maplet);
  const total = manifest.products.reduce((sum, one) => sum + one.bytes, 0);
  return element(
    "section",
    { "aria-labelledby": "release" },
    element("h2", { id: "release" }, "Release"),
    element(
      "p",
      {},
      `${manifest.body}: ${count(manifest.products.length)} files, ${bytes(total)}. `,
      downloadLink(filePath(workspace, "release/manifest.json"), "manifest.json", "Manifest"),
      " · ",
      downloadLink(filePath(workspace, "report.html"), `${workspace}-report.html`, "Report"),
      ...others.flatMap((one) => [" · ", downloadLink(filePath(workspace, `release/${one.file}`), one.file, `${one.file} (${bytes(one.bytes)})`)]),
    ),
    table<[string, Product[]]>(
      "Released models",
      [
        { title: "Model", by: ([name]) => name, cell: ([name]) => element("a", { href: hrefOf(workspace, "map", ["dtm", dtmOf(sites.get(name)!, name)]) }, name) },
        ...kinds.map((kind) => ({
          title: TITLES[kind] ?? kind,
          number: true,
          cell: ([, own]: [string, Product[]]) => {
            const one = own.find((product) => product.kind === kind);
            return one && downloadLink(filePath(workspace, `release/${one.file}`), one.file, bytes(one.bytes));
          },
        })),
        {
          title: "Made from",
          cell: ([name, own]) => {
            const one = own.find((product) => product.kind === "geotiff") ?? own[0]!;
            const query = { product: `release/${one.file}` };
            return element("a", { href: hrefOf(workspace, "runs", ["provenance"], query), "aria-label": `Provenance of ${name}` }, "provenance");
          },
        },
      ],
      [...sites],
    ),
  );
}

/** Return the name under which the map view knows a released model: that of its GeoTIFF. */
function dtmOf(own: Product[], name: string): string {
  return own.find((one) => one.kind === "geotiff")?.file.replace(/\.tif$/, "") ?? name;
}
