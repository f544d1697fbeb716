// Results of a search: the page about a word first, then guides, theory and evidence, the reference and the change log.
const PLACES = [
  [/^(howto|tutorials)\/|^(first_steps|install|glossary|index)$/, 25],
  [/^generated\/demo_/, -5],
  [/^generated\/|^changelog$|^contributing$/, -15],
];
// Pages by the words that users type. A word of the index counts the same whether a page is about it or names it once.
const ABOUT = {
  "units": ["unit"],
  "install": ["install"],
  "howto/damping": ["damping", "loss factor"],
  "howto/balloon": ["balloon", "superpressure", "lift", "helium"],
  "howto/hold": ["boundary condition", "clamp", "hinge", "joint"],
  "howto/forces": ["anchor", "resultant", "reaction", "reaction force"],
  "howto/wind": ["wind", "parachute", "drag"],
  "howto/spin": ["solar sail", "spin deployment", "spin"],
  "howto/boom": ["boom", "inflatable boom"],
  "howto/results": ["von mises", "largest stress"],
  "howto/vibration": ["imperfection", "harmonic response", "random response"],
  "howto/modes": ["mode", "frequency"],
  "howto/statics": ["equilibrium", "static"],
  "howto/prestress": ["prestress", "tension"],
  "howto/wrinkles": ["wrinkle"],
  "howto/chamber": ["chamber", "valve", "orifice"],
  "howto/contact": ["contact", "friction"],
  "howto/pattern": ["pattern"],
  "howto/gradients": ["gradient"],
  "howto/sweep": ["sweep"],
  "howto/cluster": ["cluster", "slurm", "mpi"],
  "howto/paraview": ["paraview", "vtu"],
};
const words = text => text.toLowerCase().split(/[^\p{L}\p{N}]+/u).filter(Boolean).map(word => word.replace(/s$/, "")).join(" ");
function isAbout(page, query) {
  return (ABOUT[page] || []).some(one => words(one) === words(query));
}
var Scorer = {
  score: ([page, , , , score]) => {
    const asked = typeof location === "undefined" ? "" : new URLSearchParams(location.search).get("q") || "";
    return score + (PLACES.find(([pattern]) => pattern.test(page)) || [null, 0])[1] + (isAbout(page, asked) ? 200 : 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
