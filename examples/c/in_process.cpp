// Verification in process, without a watcher: two linked rings, one of which is pulled out.
//
//     in_process              prints the linking number, the pull-through and the safe fraction
//     in_process SERVICE      publishes the same frames for `linkwatch watch --service SERVICE`

#include <linkwatch.hpp>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <vector>

namespace {

constexpr int points = 64;
const std::vector<std::int32_t> counts = {-points, -points}; // negative: closed

// Two rings of radius 1 in orthogonal planes, whose centres are `distance` apart.
std::vector<double> rings(double distance) {
  std::vector<double> out;
  for (int ring = 0; ring < 2; ring++) {
    for (int p = 0; p < points; p++) {
      const double angle = 2 * std::acos(-1.0) * (p + 0.5 * ring) / points;
      const double x = std::cos(angle) + ring * distance, y = std::sin(angle);
      out.insert(out.end(), {x, ring == 0 ? y : 0, ring == 0 ? 0 : y});
    }
  }
  return out;
}

int in_process() {
  const linkwatch::Certificate certificate = linkwatch::certify(counts, rings(1));
  for (const lw_link &link : certificate.links())
    std::cout << "linking number of curves " << link.i << " and " << link.j << ": " << link.lambda
              << '\n';

  const std::vector<lw_strut> struts = linkwatch::struts(counts, rings(1), 2.0);
  std::cout << "shortest distance of the rings: " << struts.front().length << '\n';

  // With the radius of the strands, the clearance warns before the pull-through.
  lw_session_options options{};
  options.thickness = 0.2;
  linkwatch::Session session(counts, linkwatch::Basis::Polyline, options);
  linkwatch::Verdict verdict;
  for (int frame = 0; frame <= 4; frame++) {
    verdict = session.step(rings(1 + 0.3 * frame));
    std::cout << verdict.words() << '\n';
    if (const auto clearance = session.clearance(); clearance && clearance->low)
      std::cout << "low clearance: " << 100 * clearance->ratio << " % of the diameter\n";
    if (verdict.abort) break;
  }
  std::cout << "safe fraction of the step: " << verdict.safe_share().value_or(0) << ", "
            << linkwatch::safe_fraction(counts, rings(1.9), rings(2.2)) << '\n';
  return verdict.intact() ? 0 : 1;
}

int live(const std::string &service) {
  linkwatch::Client<double> client(service, counts);
  if (!client.wait_for_watcher(10)) std::cerr << "no watcher came in time\n";
  bool broken = false;
  for (int frame = 0; frame <= 4; frame++) {
    const std::vector<double> from = rings(1 + 0.3 * frame);
    std::copy(from.begin(), from.end(), client.begin(0.1 * frame));
    const auto verdict = client.wait(client.publish(), 10);
    if (!verdict) throw linkwatch::Error(lw_last_error());
    std::cout << verdict->words() << '\n';
    broken = broken || !verdict->intact();
  }
  if (const auto last = client.finish(10)) std::cout << last->words() << '\n';
  return broken ? 1 : 0;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return argc > 1 ? live(argv[1]) : in_process();
  } catch (const linkwatch::Error &error) {
    std::cerr << "error: " << error.what() << '\n';
    return 2;
  }
}
