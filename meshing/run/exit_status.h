// How the programs end: what they return to the shell, the same in all of them.
#pragma once

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace testbed::meshing {

enum ExitStatus { kSolved = 0, kError = 1, kNotOk = 2, kNotModelled = 3 };

constexpr const char* kExitStatusHelp =
    "Exit status: 0 solved; 1 error, no result; 2 a result is written, but its status is not ok (not\n"
    "converged, diverged, energy gained, strain too large, stopped early); 3 the reference does not model\n"
    "a part of the scene. A stored result gives its status again.\n";

/// Of a run by its record (run.json), whose status and reason are told on stderr unless it is ok.
inline ExitStatus tell_status(const std::string& scene, const nlohmann::ordered_json& record) {
  const std::string status = record.at("status"), reason = record.value("reason", "");
  if (status == "ok") return kSolved;
  std::cerr << status << ": " << scene << (reason.empty() ? "" : ": ") << reason << '\n';
  return status == "not_solved" ? kNotModelled : kNotOk;
}

/// Tells an error and ends at once: where memory is short, threads of OpenBLAS ask for it without end, and a program that
/// returns waits for them.
[[noreturn]] inline void end_by(const std::string& error) {
  std::cout.flush();
  std::fflush(nullptr);
  std::cerr << "error: " << error << '\n';
  _exit(kError);
}

/// What a program is to return at once after its command line: help was asked for, or the line is wrong.
inline std::optional<int> parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kSolved : kError;
  }
  return {};
}

}  // namespace testbed::meshing
