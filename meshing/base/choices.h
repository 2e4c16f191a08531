// What a scene chooses by name, and the tables of those names.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// A value of an enum and its name in files.
template <class Enum>
struct Named {
  Enum value;
  const char* name;
};

/// Whether an enum declares a value: of one that it does not, compilers write the number.
template <auto value>
constexpr bool is_declared() {
  constexpr std::string_view kText = __PRETTY_FUNCTION__, kBefore = "value = ";
  return kText[kText.find(kBefore) + kBefore.size()] != '(';
}

/// Whether an enum's table names each of its values once, which count from 0; the order is free.
template <class Enum>
constexpr bool is_complete() {
  constexpr auto kTable = names_of(Enum());
  for (size_t value = 0; value < kTable.size(); ++value) {
    int n_rows = 0;
    for (const Named<Enum>& row : kTable) n_rows += row.value == static_cast<Enum>(value);
    if (n_rows != 1) return false;
  }
  return !is_declared<static_cast<Enum>(kTable.size())>();
}

/// The name of a value; every enum with a table names_of has one.
template <class Enum>
const char* name_of(Enum value) {
  static_assert(is_complete<Enum>());
  for (const Named<Enum>& row : names_of(value))
    if (row.value == value) return row.name;
  return "";  // of no declared value
}

/// The value of a name, if there is one.
template <class Enum>
std::optional<Enum> value_of(std::string_view name) {
  static_assert(is_complete<Enum>());
  for (const Named<Enum>& row : names_of(Enum()))
    if (row.name == name) return row.value;
  return {};
}

/// Every name of an enum's values.
template <class Enum>
std::vector<std::string> all_names() {
  std::vector<std::string> names;
  for (const Named<Enum>& row : names_of(Enum())) names.emplace_back(row.name);
  return names;
}

enum class TimeMode { Static, Dynamic };
constexpr std::array<Named<TimeMode>, 2> names_of(TimeMode) {
  return {{{TimeMode::Static, "static"}, {TimeMode::Dynamic, "dynamic"}}};
}

/// Method for the linear systems of the linearised implicit step.
enum class Krylov { Cg, BiCg, BiCgStab };
constexpr std::array<Named<Krylov>, 3> names_of(Krylov) {
  return {{{Krylov::Cg, "cg"}, {Krylov::BiCg, "bicg"}, {Krylov::BiCgStab, "bicgstab"}}};
}

/// Tension of an independent spring compressed below its rest length r; above it both are
/// Hooke's [massspring/README.md (3) to (6)].
enum class SpringLaw {
  Hooke,    ///< k_s (l - r): a network of such springs loses ellipticity at 20 % hydrostatic compression
  Definite  ///< k_s r/4 (1 - (r/l)^4): the same stiffness at rest, without bound as l -> 0
};
constexpr std::array<Named<SpringLaw>, 2> names_of(SpringLaw) {
  return {{{SpringLaw::Hooke, "hooke"}, {SpringLaw::Definite, "definite"}}};
}

/// Of an obstacle that overlaps the body as a motion begins.
enum class Overlap { Refuse, Resolve };
constexpr std::array<Named<Overlap>, 2> names_of(Overlap) {
  return {{{Overlap::Refuse, "refuse"}, {Overlap::Resolve, "resolve"}}};
}

enum class MassMatrix { Consistent, Lumped };
constexpr std::array<Named<MassMatrix>, 2> names_of(MassMatrix) {
  return {{{MassMatrix::Consistent, "consistent"}, {MassMatrix::Lumped, "lumped"}}};
}

/// SmallStrain is linear, and fair below a few per cent of strain and small rotations; NeoHookean goes beyond.
enum class MaterialLaw { SmallStrain, NeoHookean };
constexpr std::array<Named<MaterialLaw>, 2> names_of(MaterialLaw) {
  return {{{MaterialLaw::SmallStrain, "small_strain"}, {MaterialLaw::NeoHookean, "neo_hookean"}}};
}

/// Of the nodes inside a spring network.
enum class Sampling {
  Darts,    ///< the paper's: random points that pass the three tests of figure 4
  Relaxed,  ///< then moved towards the centres of their cells: more even, but phi is no longer kept
  Graded    ///< moved likewise, to be as dense as the surface nearby
};

constexpr std::array<Named<Sampling>, 3> names_of(Sampling) {
  return {{{Sampling::Darts, "darts"}, {Sampling::Relaxed, "relaxed"}, {Sampling::Graded, "graded"}}};
}

/// Which nodes of a network springs join.
enum class Connectivity {
  Surface,      ///< the surface's edges alone; internal nodes are left out
  Central,      ///< one node at the vertices' mean, linked to every vertex [paper fig. 3c]
  Complete,     ///< every pair [paper fig. 3b]
  Delaunay,     ///< edges of the nodes' Delaunay tetrahedra
  Pcp,          ///< the paper's
  CompletedPcp  ///< PCP and symmetric nearest neighbours, and further links until it is rigid
};

constexpr std::array<Named<Connectivity>, 6> names_of(Connectivity) {
  return {{{Connectivity::Surface, "surface"},
           {Connectivity::Central, "central"},
           {Connectivity::Complete, "complete"},
           {Connectivity::Delaunay, "delaunay"},
           {Connectivity::Pcp, "pcp"},
           {Connectivity::CompletedPcp, "completed_pcp"}}};
}

/// How to read the pseudocode of figure 8.
enum class PcpReading {
  /// Gray nodes turn white when all white ones of the stage are done; ends with the last black node.
  StageWise,
  WholeLastStage,  ///< the same, but every white node of the last stage projects its springs
  Literal          ///< gray nodes turn white after each white node: a tree
};

constexpr std::array<Named<PcpReading>, 3> names_of(PcpReading) {
  return {{{PcpReading::StageWise, "stage_wise"},
           {PcpReading::WholeLastStage, "whole_last_stage"},
           {PcpReading::Literal, "literal"}}};
}

/// The axis of a surface's file that points up.
enum class UpAxis { Y, Z };
constexpr std::array<Named<UpAxis>, 2> names_of(UpAxis) {
  return {{{UpAxis::Y, "y"}, {UpAxis::Z, "z"}}};
}

/// Of a surface's coordinates.
enum class LengthUnit { Metre, Centimetre, Millimetre, Inch };
constexpr std::array<Named<LengthUnit>, 4> names_of(LengthUnit) {
  return {{{LengthUnit::Metre, "m"},
           {LengthUnit::Centimetre, "cm"},
           {LengthUnit::Millimetre, "mm"},
           {LengthUnit::Inch, "in"}}};
}

}  // namespace testbed::meshing
