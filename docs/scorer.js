// Results of a search: guides first, then theory and evidence, then the reference and the change log.
const PLACES = [
  [/^(howto|tutorials)\/|^(first_steps|install|glossary|index)$/, 25],
  [/^generated\/demo_/, -5],
  [/^generated\/|^changelog$|^contributing$/, -15],
];
var Scorer = {
  score: ([page, , , , score]) => score + (PLACES.find(([pattern]) => pattern.test(page)) || [null, 0])[1],
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
